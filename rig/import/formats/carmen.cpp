// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <fstream>
#include <memory>
#include <sstream>

#include "rig/errors.hpp"
#include "rig/import/importer.hpp"

namespace rig::importers {
namespace {

constexpr std::size_t longest_line = 1 << 20;
constexpr std::size_t most_beams = 100'000;
constexpr double largest_range_m = 65.535;

struct Pose {
  double x_m = 0, y_m = 0, heading_rad = 0;
};

/// The words of one line, in order; `whole()` turns false instead of reading past the end.
class Words {
 public:
  explicit Words(const std::string& line) : in_(line) {}
  std::string word() {
    std::string result;
    whole_ = whole_ && static_cast<bool>(in_ >> result);
    return result;
  }
  double number() {
    const std::string text = word();
    char* end = nullptr;
    const double value = std::strtod(text.c_str(), &end);
    whole_ = whole_ && end != text.c_str() && *end == 0 && std::isfinite(value);
    return value;
  }
  std::vector<double> numbers() {
    const double count = number();
    if (!whole_ || count < 0 || count > static_cast<double>(most_beams)) {
      whole_ = false;
      return {};
    }
    std::vector<double> values(static_cast<std::size_t>(count));
    for (auto& value : values) {
      value = number();
      if (!whole_) return {};
    }
    return values;
  }
  Pose pose() {
    Pose result;
    result.x_m = number();
    result.y_m = number();
    result.heading_rad = number();
    return result;
  }
  [[nodiscard]] bool whole() const { return whole_; }

 private:
  std::istringstream in_;
  bool whole_ = true;
};

/// Spacing of a FLASER line, which does not say it: these lines come from 180-degree scanners of 1, 0.5 or
/// 0.25 degrees, with or without the beam that closes the half circle.
double half_circle_step(std::size_t beams) {
  const double spaces = static_cast<double>(beams % 2 == 1 ? beams - 1 : beams);
  return fit::pi / std::max(1.0, spaces);
}

/// CARMEN logs (message formats of the CARMEN logger): one message a line, metres and radians, the robot's
/// and the lidar's pose with every scan.
class Reader {
 public:
  explicit Reader(ImportSink& sink) : sink_(sink) {}

  void line(const std::string& text) {
    Words words(text);
    const std::string kind = words.word();
    if (kind == "ODOM")
      odometry(words);
    else if (kind == "FLASER")
      flaser(words);
    else if (kind == "ROBOTLASER1" || kind == "RAWLASER1")
      laser(words, kind == "ROBOTLASER1");
    else
      return;
    if (!words.whole()) ++faulty_;
  }

  [[nodiscard]] std::uint64_t faulty() const { return faulty_; }

 private:
  void odometry(Words& words) {
    const Pose pose = words.pose();
    words.number();  // speeds and acceleration
    words.number();
    words.number();
    const double time_s = words.number();
    if (words.whole()) track(time_s, pose);
  }

  void flaser(Words& words) {
    const auto ranges = words.numbers();
    const Pose lidar = words.pose(), robot = words.pose();
    const double time_s = words.number();
    if (!words.whole() || ranges.empty()) return;
    place(lidar, robot);
    track(time_s, robot);
    scan(time_s, "FLASER", -fit::pi / 2, half_circle_step(ranges.size()), ranges, largest_range_m, {});
  }

  void laser(Words& words, bool with_robot) {
    words.number();  // lidar type
    const double first = words.number();
    words.number();  // field of view
    const double step = words.number();
    const double farthest_m = words.number();
    words.number();  // accuracy
    words.number();  // remission mode
    const auto ranges = words.numbers();
    const auto remissions = words.numbers();
    Pose lidar, robot;
    if (with_robot) {
      lidar = words.pose();
      robot = words.pose();
      for (int i = 0; i < 5; ++i) words.number();  // speeds, safety distances, turn axis
    }
    const double time_s = words.number();
    if (!words.whole() || ranges.empty() || step == 0) return;
    if (with_robot) {
      place(lidar, robot);
      track(time_s, robot);
    }
    scan(time_s, with_robot ? "ROBOTLASER1" : "RAWLASER1", first, step, ranges,
         std::min(farthest_m, largest_range_m), remissions);
  }

  void track(double time_s, const Pose& pose) {
    fit::TrackPose result;
    result.x_mm = pose.x_m * 1000;
    result.y_mm = pose.y_m * 1000;
    result.heading_rad = pose.heading_rad;
    sink_.pose(nanoseconds(time_s), "odometry", "robot", result);
  }

  /// The lidar's place on the robot, from the first scan: later ones repeat it.
  void place(const Pose& lidar, const Pose& robot) {
    if (placed_) return;
    placed_ = true;
    const double dx = lidar.x_m - robot.x_m, dy = lidar.y_m - robot.y_m;
    const double c = std::cos(robot.heading_rad), s = std::sin(robot.heading_rad);
    const double yaw = lidar.heading_rad - robot.heading_rad;
    ImportedTransform transform{"robot", "lidar"};
    transform.x_mm = 1000 * (c * dx + s * dy);
    transform.y_mm = 1000 * (-s * dx + c * dy);
    transform.qw = std::cos(yaw / 2);
    transform.qz = std::sin(yaw / 2);
    sink_.transform(transform);
  }

  void scan(double time_s, const std::string& source, double first_rad, double step_rad,
            const std::vector<double>& ranges, double farthest_m, const std::vector<double>& remissions) {
    range_mm_.clear();
    for (const double range : ranges)
      range_mm_.push_back(
          range > 0 && range < farthest_m ? static_cast<std::uint16_t>(std::lround(range * 1000)) : 0);
    intensity_.clear();
    if (remissions.size() == ranges.size())
      for (const double value : remissions)
        intensity_.push_back(static_cast<std::uint16_t>(std::clamp(value, 0.0, 65535.0)));
    ImportedScan result;
    result.stamp_ns = nanoseconds(time_s);
    result.source = source;
    result.frame = "lidar";
    result.geometry.first_rad = first_rad;
    result.geometry.step_rad = step_rad;
    result.range_mm = range_mm_;
    result.intensity = intensity_;
    sink_.scan(result);
  }

  static std::int64_t nanoseconds(double seconds) {
    return static_cast<std::int64_t>(std::clamp(seconds, -9e9, 9e9) * 1e9);
  }

  ImportSink& sink_;
  bool placed_ = false;
  std::uint64_t faulty_ = 0;
  std::vector<std::uint16_t> range_mm_, intensity_;
};

class Carmen : public Importer {
 public:
  std::string name() const override { return "CARMEN log"; }

  bool recognises(const std::string& path, std::span<const std::uint8_t> first_bytes) const override {
    const std::string_view text(reinterpret_cast<const char*>(first_bytes.data()), first_bytes.size());
    const bool named = path.ends_with(".log") || path.ends_with(".clf") || path.ends_with(".carmen");
    return text.find("CARMEN") != text.npos || text.starts_with("FLASER ") || text.starts_with("ODOM ") ||
           text.starts_with("ROBOTLASER1 ") || text.starts_with("RAWLASER1 ") || text.starts_with("PARAM ") ||
           (named && (text.find("\nFLASER ") != text.npos || text.find("\nROBOTLASER1 ") != text.npos ||
                      text.find("\nPARAM ") != text.npos));
  }

  void read(const std::string& path, const ImportOptions&, ImportSink& sink) const override {
    std::ifstream in(path);
    if (!in) throw UsageError(path + " cannot be opened. Check the name and the permissions.");
    Reader reader(sink);
    std::string line;
    while (sink.wants_more() && std::getline(in, line)) {
      if (line.size() > longest_line)
        throw UsageError(path + " has a line of more than a million characters: it is not a CARMEN log.");
      reader.line(line);
    }
    if (reader.faulty() > 0)
      sink.note(std::to_string(reader.faulty()) + " lines were cut or absurd and left out.");
  }
};

}  // namespace

std::unique_ptr<Importer> make_carmen() { return std::make_unique<Carmen>(); }

}  // namespace rig::importers
