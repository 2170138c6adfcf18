// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <sstream>

#include "rig/errors.hpp"
#include "rig/import/importer.hpp"
#include "rig/text_lines.hpp"

namespace rig::importers {
namespace {

constexpr std::size_t longest_line = 1 << 20;
constexpr std::size_t most_beams = 100'000;

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
  /// The end of every line, perhaps missing: the computer's name and when the logger wrote it.
  std::optional<double> logged() {
    std::string name;
    double time_s = 0;
    return in_ >> name >> time_s ? std::optional(time_s) : std::nullopt;
  }
  [[nodiscard]] bool whole() const { return whole_; }

 private:
  std::istringstream in_;
  bool whole_ = true;
};

/// Spacing of a FLASER or RLASER line, which does not say it: these lines come from 180-degree scanners of 1,
/// 0.5 or 0.25 degrees, with or without the beam that closes the half circle; some logs name it in a PARAM.
double half_circle_step(std::size_t beams) {
  const double spaces = static_cast<double>(beams % 2 == 1 ? beams - 1 : beams);
  return fit::pi / std::max(1.0, spaces);
}

/// Which of the robot's lasers a kind of line is of: 1 in front, 2 behind, others by their number; 0: none.
int laser_of(const std::string& kind) {
  if (kind == "FLASER") return 1;
  if (kind == "RLASER") return 2;
  for (const char* name : {"ROBOTLASER", "RAWLASER"})
    if (kind.starts_with(name) && kind.size() == std::strlen(name) + 1 && kind.back() >= '1' &&
        kind.back() <= '9')
      return kind.back() - '0';
  return 0;
}

/// CARMEN logs (message formats of the CARMEN logger): one message a line, metres and radians, the robot's
/// and the lidar's pose with every scan. Of several lasers the first in the file is taken, or the one whose
/// lines the options name.
class CarmenReader {
 public:
  CarmenReader(const ImportOptions& options, ImportSink& sink)
      : sink_(sink), taken_(laser_of(options.scan_topic)) {}

  void line(const std::string& text) {
    Words words(text);
    const std::string kind = words.word();
    const int laser_number = laser_of(kind);
    if (kind == "PARAM") return parameter(words);
    if (kind == "ODOM") {
      odometry(words);
    } else if (laser_number != 0) {
      if (taken_ == 0) taken_ = laser_number;
      if (laser_number != taken_) {
        passed_over_.insert(kind);
        return;
      }
      if (kind == "FLASER" || kind == "RLASER")
        half_circle(words, kind);
      else
        laser(words, kind);
    } else {
      return;
    }
    if (!words.whole()) ++faulty_;
  }

  void finish() {
    if (faulty_ > 0)
      sink_.note(std::to_string(faulty_) + " lines were truncated or implausible and left out.");
    if (twice_ > 0)
      sink_.note(std::to_string(twice_) + " scans stand in two kinds of lines: each was taken once.");
    for (const auto& kind : passed_over_)
      sink_.note("Lines " + kind + " were left out: another laser's were used. Use --topic " + kind +
                 " to take them instead.");
  }

 private:
  void odometry(Words& words) {
    const Pose pose = words.pose();
    words.number();  // speeds and acceleration
    words.number();
    words.number();
    const double time_s = time_of(words);
    if (words.whole()) track(time_s, pose);
  }

  void parameter(Words& words) {
    const std::string name = words.word(), value = words.word();
    if (name == "laser_front_laser_resolution" || name == "laser_rear_laser_resolution")
      if (const double deg = std::strtod(value.c_str(), nullptr); deg > 0.01 && deg < 10)
        resolution_rad_[name.find("rear") == name.npos ? 1 : 2] = deg * fit::rad_per_deg;
  }

  /// Time of the message; where the sender gave none (0), the logger's.
  static double time_of(Words& words) {
    const double sent_s = words.number();
    return words.whole() && sent_s == 0 ? words.logged().value_or(0) : sent_s;
  }

  void half_circle(Words& words, const std::string& kind) {
    const auto ranges = words.numbers();
    const Pose lidar = words.pose(), robot = words.pose();
    const double time_s = time_of(words);
    if (!words.whole() || ranges.empty()) return;
    place(lidar, robot);
    track(time_s, robot);
    const auto stated = resolution_rad_.find(laser_of(kind));
    double step = half_circle_step(ranges.size());
    if (stated != resolution_rad_.end() && stated->second * static_cast<double>(ranges.size()) < 2 * fit::pi)
      step = stated->second;
    const double first = stated == resolution_rad_.end()
                             ? -fit::pi / 2
                             : -step * std::floor(static_cast<double>(ranges.size()) / 2);
    scan(time_s, kind, first, step, ranges, std::numeric_limits<double>::infinity(), {});
  }

  void laser(Words& words, const std::string& kind) {
    const bool with_robot = kind.starts_with("ROBOT");
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
    const double time_s = time_of(words);
    if (!words.whole() || ranges.empty() || step == 0) return;
    if (with_robot) {
      place(lidar, robot);
      track(time_s, robot);
    }
    scan(time_s, kind, first, step, ranges, farthest_m, remissions);
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
    if (last_s_ && std::abs(*last_s_ - time_s) < 1e-4 && source != last_source_) {
      ++twice_;
      return;
    }
    last_s_ = time_s, last_source_ = source;
    range_mm_.clear();
    for (const double range : ranges)
      range_mm_.push_back(range_of(range < farthest_m ? std::optional(range * 1000) : std::nullopt));
    intensity_.clear();
    if (remissions.size() == ranges.size())
      for (const double value : remissions) intensity_.push_back(intensity_of(value));
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
  int taken_;
  bool placed_ = false;
  std::uint64_t faulty_ = 0, twice_ = 0;
  std::map<int, double> resolution_rad_;  ///< By laser.
  std::set<std::string> passed_over_;
  std::optional<double> last_s_;
  std::string last_source_;
  std::vector<std::uint16_t> range_mm_, intensity_;
};

class Carmen : public Importer {
 public:
  std::string name() const override { return "CARMEN log"; }

  bool recognises(const std::string& path, std::span<const std::uint8_t> first_bytes) const override {
    const std::string_view text(reinterpret_cast<const char*>(first_bytes.data()), first_bytes.size());
    const bool named = path.ends_with(".log") || path.ends_with(".clf") || path.ends_with(".carmen");
    return text.find("CARMEN") != text.npos || text.starts_with("FLASER ") || text.starts_with("ODOM ") ||
           text.starts_with("RLASER ") || text.starts_with("ROBOTLASER") || text.starts_with("RAWLASER") ||
           text.starts_with("PARAM ") ||
           (named && (text.find("\nFLASER ") != text.npos || text.find("\nRLASER ") != text.npos ||
                      text.find("\nROBOTLASER") != text.npos || text.find("\nRAWLASER") != text.npos ||
                      text.find("\nPARAM ") != text.npos));
  }

  void read(const std::string& path, const ImportOptions& options, ImportSink& sink) const override {
    std::ifstream in(path);
    if (!in) throw UsageError(path + " cannot be opened. Check the name and the permissions.");
    CarmenReader reader(options, sink);
    std::string line;
    while (sink.wants_more() && std::getline(in, line)) {
      if (line.size() > longest_line)
        throw UsageError(path + " has a line of more than a million characters: it is not a CARMEN log.");
      reader.line(line);
    }
    reader.finish();
  }
};

}  // namespace

std::unique_ptr<Importer> make_carmen() { return std::make_unique<Carmen>(); }

}  // namespace rig::importers
