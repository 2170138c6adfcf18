// SPDX-License-Identifier: MIT
#pragma once

#include <map>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "rig/import/importer.hpp"

namespace rig {

/// Turns the messages of ROS 2 bags, whatever stores them, into scans, poses and transforms:
/// sensor_msgs/LaserScan, JointState, Imu; nav_msgs/Odometry; tf2_msgs/TFMessage of static topics. Of several
/// topics of one kind the first seen is taken, or the one the options name; the others are noted.
/// A message that is cut or absurd is counted and left out.
class RosMessages {
 public:
  RosMessages(ImportSink& sink, const ImportOptions& options) : sink_(sink), options_(options) {}

  void message(const std::string& topic, const std::string& type, std::int64_t log_time_ns,
               std::span<const std::uint8_t> cdr);
  /// To be called once after the last message: what was left out goes to the sink's notes.
  void finish();

 private:
  enum class Kind { other, scan, odometry, joints, imu, static_transform };
  void decode(Kind kind, const std::string& topic, std::int64_t log_time_ns,
              std::span<const std::uint8_t> cdr);
  void laser_scan(const std::string& topic, std::int64_t log_time_ns, std::span<const std::uint8_t> cdr);
  void odometry(const std::string& topic, std::int64_t log_time_ns, std::span<const std::uint8_t> cdr);
  void joint_state(const std::string& topic, std::int64_t log_time_ns, std::span<const std::uint8_t> cdr);
  void imu(const std::string& topic, std::int64_t log_time_ns, std::span<const std::uint8_t> cdr);
  void transforms(std::span<const std::uint8_t> cdr);
  std::int64_t stamp(std::int32_t sec, std::uint32_t nanosec, std::int64_t log_time_ns);
  [[nodiscard]] bool chosen(Kind kind, const std::string& topic, const std::string& wanted);

  ImportSink& sink_;
  const ImportOptions& options_;
  std::map<Kind, std::string> taken_;
  std::map<std::string, Kind> passed_over_;
  std::map<std::string, std::uint64_t> faulty_;
  std::set<std::string> types_seen_;
  std::uint64_t messages_ = 0, unstamped_ = 0, too_far_ = 0;
  std::vector<std::uint16_t> range_mm_, intensity_;
};

/// Heading of a rotation given as a quaternion (z up): atan2(2 (w z + x y), 1 - 2 (y^2 + z^2)).
[[nodiscard]] double yaw_of(double w, double x, double y, double z);

}  // namespace rig
