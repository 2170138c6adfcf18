// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <fstream>
#include <memory>
#include <sstream>

#include "rig/errors.hpp"
#include "rig/import/importer.hpp"
#include "rig/import/wheel_counter.hpp"
#include "rig/text_lines.hpp"

namespace rig::importers {
namespace {

// The logs of the rover of Mines ParisTech, as BreezySLAM's and CoreSLAM's examples ship them: a line a scan
// of whole numbers. Column 0 holds microseconds, 2 and 3 the ticks of the left and the right wheel, and
// behind 24 columns follow the 682 ranges of a URG-04LX in millimetres, 0 where there is none.
constexpr std::size_t time_column = 0, left_column = 2, right_column = 3, first_range = 24, rover_beams = 682;
constexpr double rover_turn_hz = 10, rover_step_rad = 2 * fit::pi / 1024;
// As BreezySLAM's rover documents: lidar 145 mm ahead of the axle, and 0.09 deg of the wheel a tick; but its
// code adds the ways of both wheels where it should take their mean, so that in truth a tick is 0.18 deg.
constexpr double documented_ticks_a_turn = 2000, documented_ahead_mm = 145;
constexpr double rover_farthest_mm = 5600;  // what the lidar can mean

bool is_row(std::string_view line) {
  std::size_t numbers = 0;
  for (const std::string_view word : split(trimmed(line), ' ')) {
    if (word.empty()) continue;
    if (!number_in(word)) return false;
    ++numbers;
  }
  return numbers >= first_range + rover_beams && numbers <= first_range + rover_beams + 2;
}

class RoverLog {
 public:
  RoverLog(const ImportOptions& options, ImportSink& sink)
      : options_(options),
        sink_(sink),
        left_(options.ticks_a_turn.value_or(documented_ticks_a_turn), false),
        right_(left_) {}

  void line(std::string_view text) {
    std::vector<double> values;
    for (const std::string_view word : split(trimmed(text), ' ')) {
      if (word.empty()) continue;
      const auto value = number_in(word);
      if (!value) break;
      values.push_back(*value);
    }
    if (values.size() < first_range + rover_beams) {
      faulty_ += trimmed(text).empty() ? 0 : 1;
      return;
    }
    const auto stamp_ns = static_cast<std::int64_t>(std::clamp(values[time_column], -9e15, 9e15) * 1e3);
    if (!placed_) begin();
    fit::TrackPose wheels;
    wheels.wheel_left_rad = left_.angle(values[left_column]);
    wheels.wheel_right_rad = right_.angle(values[right_column]);
    sink_.pose(stamp_ns, "wheels", "robot", wheels);
    range_mm_.clear();
    for (std::size_t k = 0; k < rover_beams; ++k) {
      const double mm = values[first_range + k];
      too_far_ += mm > rover_farthest_mm ? 1 : 0;
      range_mm_.push_back(range_of(mm > rover_farthest_mm ? std::optional<double>() : std::optional(mm)));
    }
    ImportedScan scan;
    scan.stamp_ns = stamp_ns;
    scan.source = "BreezySLAM";
    scan.frame = "lidar";
    scan.geometry.first_rad =
        options_.first_deg ? *options_.first_deg * fit::rad_per_deg : -340 * rover_step_rad;
    scan.geometry.step_rad = options_.step_deg ? *options_.step_deg * fit::rad_per_deg : rover_step_rad;
    scan.geometry.scan_s = std::abs(scan.geometry.step_rad) * rover_beams / (2 * fit::pi) /
                           options_.scan_hz.value_or(rover_turn_hz);
    scan.range_mm = range_mm_;
    sink_.scan(scan);
  }

  void finish() {
    if (faulty_ > 0)
      sink_.note(std::to_string(faulty_) + " lines were truncated or implausible and left out.");
    if (too_far_ > 0)
      sink_.note(std::to_string(too_far_) +
                 " ranges beyond 5.6 m, which a URG-04LX cannot measure, were treated as no echo.");
  }

 private:
  void begin() {
    placed_ = true;
    sink_.property("model", "URG-04LX");
    ImportedTransform ahead{"robot", "lidar"};
    ahead.x_mm = documented_ahead_mm;
    sink_.transform(ahead);
    sink_.note(
        "The lidar's place (145 mm ahead of the axle) is the one that BreezySLAM documents for this "
        "rover" +
        std::string(options_.ticks_a_turn
                        ? "."
                        : ", and so are the 2000 ticks a turn; --ticks-a-turn names another number."));
  }

  const ImportOptions& options_;
  ImportSink& sink_;
  WheelCounter left_, right_;
  bool placed_ = false;
  std::uint64_t faulty_ = 0, too_far_ = 0;
  std::vector<std::uint16_t> range_mm_;
};

class BreezySlam : public Importer {
 public:
  std::string name() const override { return "BreezySLAM or CoreSLAM rover log (.dat)"; }

  /// By its first line, which may be longer than what was read of it.
  bool recognises(const std::string& path, std::span<const std::uint8_t> first_bytes) const override {
    const std::string_view text(reinterpret_cast<const char*>(first_bytes.data()), first_bytes.size());
    if (text.find('\0') != text.npos || text.find_first_of(",;\t") != text.npos) return false;
    if (!(path.ends_with(".dat") || path.ends_with(".txt") || path.ends_with(".log"))) return false;
    std::ifstream in(path, std::ios::binary);
    std::string line;
    bool too_long = false;
    return next_line(in, line, too_long) && is_row(line);
  }

  void read(const std::string& path, const ImportOptions& options, ImportSink& sink) const override {
    std::ifstream in(path, std::ios::binary);
    if (!in) throw UsageError(path + " cannot be opened. Check the name and the permissions.");
    RoverLog log(options, sink);
    std::string line;
    bool too_long = false;
    while (sink.wants_more() && next_line(in, line, too_long)) log.line(line);
    if (too_long)
      throw UsageError(path + " has a line of more than four million characters: it is not such a log.");
    log.finish();
  }
};

}  // namespace

std::unique_ptr<Importer> make_breezyslam() { return std::make_unique<BreezySlam>(); }

}  // namespace rig::importers
