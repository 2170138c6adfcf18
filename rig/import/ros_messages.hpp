// SPDX-License-Identifier: MIT
#pragma once

#include <map>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "rig/import/cdr.hpp"
#include "rig/import/importer.hpp"

namespace rig {

/// Turns the messages of ROS 1 and ROS 2 bags, whatever stores them, into scans, poses and transforms:
/// sensor_msgs/LaserScan, JointState, Imu; nav_msgs/Odometry; tf2_msgs/TFMessage (tf/tfMessage). Of several
/// topics of one kind the first seen is taken, or the one the options name; the others are noted.
/// Of moving transforms those that never move tell how the robot is built (as ROS 1 publishes it); the one
/// from a frame named like "odom" is the odometry where there is no other.
/// A message that is cut or absurd is counted and left out.
class RosMessages {
 public:
  RosMessages(ImportSink& sink, const ImportOptions& options, Packing packing = Packing::cdr)
      : sink_(sink), options_(options), packing_(packing) {}

  void message(const std::string& topic, const std::string& type, std::int64_t log_time_ns,
               std::span<const std::uint8_t> bytes);
  /// To be called once after the last message: what was left out goes to the sink's notes.
  void finish();

 private:
  enum class Kind { other, scan, odometry, joints, imu, transforms };
  struct MovingTransform {
    std::int64_t from_ns, until_ns;
    ImportedTransform transform;
  };
  void decode(Kind kind, const std::string& topic, std::int64_t log_time_ns, CdrReader in);
  void laser_scan(const std::string& topic, std::int64_t log_time_ns, CdrReader& in);
  void odometry(const std::string& topic, std::int64_t log_time_ns, CdrReader& in);
  void joint_state(const std::string& topic, std::int64_t log_time_ns, CdrReader& in);
  void imu(const std::string& topic, std::int64_t log_time_ns, CdrReader& in);
  void transforms(std::int64_t log_time_ns, CdrReader& in, bool fixed);
  void finish_transforms();
  std::int64_t stamp(std::int32_t sec, std::uint32_t nanosec, std::int64_t log_time_ns);
  [[nodiscard]] bool chosen(Kind kind, const std::string& topic, const std::string& wanted);

  ImportSink& sink_;
  const ImportOptions& options_;
  Packing packing_;
  std::map<std::string, std::vector<MovingTransform>> moving_;  ///< By child.
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
