// SPDX-License-Identifier: MIT
#include "rig/import/ros_messages.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "fit/echo.hpp"
#include "rig/text_lines.hpp"

namespace rig {
namespace {

constexpr std::size_t most_beams = 100'000;

constexpr std::size_t most_frames = 1000, most_moves = 5'000'000;

bool same_place(const ImportedTransform& a, const ImportedTransform& b) {
  constexpr double least_mm = 1e-3, least = 1e-7;
  const auto near = [](double x, double y, double limit) { return std::abs(x - y) < limit; };
  return a.parent == b.parent && near(a.x_mm, b.x_mm, least_mm) && near(a.y_mm, b.y_mm, least_mm) &&
         near(a.z_mm, b.z_mm, least_mm) && near(a.qx, b.qx, least) && near(a.qy, b.qy, least) &&
         near(a.qz, b.qz, least) && near(a.qw, b.qw, least);
}

struct Header {
  std::int32_t sec;
  std::uint32_t nanosec;
  std::string frame;
};

Header read_header(CdrReader& in) {
  Header header;
  if (in.packing() == Packing::ros1) in.skip<std::uint32_t>(1);  // a running number
  header.sec = in.value<std::int32_t>();
  header.nanosec = in.value<std::uint32_t>();
  header.frame = in.text();
  return header;
}

/// rosbag2 writes "sensor_msgs/msg/LaserScan"; older recorders "sensor_msgs/LaserScan".
std::string short_type(const std::string& type) {
  const auto slash = type.rfind('/');
  const auto first = type.find('/');
  return slash == std::string::npos ? type : type.substr(0, first) + type.substr(slash);
}

bool same_topic(const std::string& topic, const std::string& wanted) {
  return topic == wanted || topic == "/" + wanted;
}

/// The wheel's place in the list of joints: the name the operator gave, or the first that says its side.
std::size_t wheel_index(const std::vector<std::string>& names, const std::string& wanted,
                        const std::string& side) {
  for (std::size_t i = 0; i < names.size(); ++i) {
    std::string lower = names[i];
    std::transform(lower.begin(), lower.end(), lower.begin(),
                   [](unsigned char c) { return std::tolower(c); });
    if (wanted.empty() ? lower.find(side) != std::string::npos : names[i] == wanted) return i;
  }
  return names.size();
}

}  // namespace

double yaw_of(double w, double x, double y, double z) {
  return std::atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z));
}

void RosMessages::message(const std::string& topic, const std::string& type, std::int64_t log_time_ns,
                          std::span<const std::uint8_t> bytes) {
  ++messages_;
  const std::string plain = short_type(type);
  if (types_seen_.size() < 100) types_seen_.insert(plain);
  static const std::map<std::string, Kind> kinds{
      {"sensor_msgs/LaserScan", Kind::scan},    {"nav_msgs/Odometry", Kind::odometry},
      {"sensor_msgs/JointState", Kind::joints}, {"sensor_msgs/Imu", Kind::imu},
      {"tf2_msgs/TFMessage", Kind::transforms}, {"tf/tfMessage", Kind::transforms}};
  const auto kind = kinds.find(plain);
  if (kind == kinds.end()) return;
  try {
    decode(kind->second, topic, log_time_ns, CdrReader(bytes, packing_));
  } catch (const CdrError&) {
    ++faulty_[topic];
  }
}

void RosMessages::decode(Kind kind, const std::string& topic, std::int64_t log_time_ns, CdrReader in) {
  switch (kind) {
    case Kind::scan:
      if (chosen(kind, topic, options_.scan_topic)) laser_scan(topic, log_time_ns, in);
      break;
    case Kind::odometry:
      if (chosen(kind, topic, options_.odometry_topic)) odometry(topic, log_time_ns, in);
      break;
    case Kind::joints:
      joint_state(topic, log_time_ns, in);
      break;
    case Kind::imu:
      if (chosen(kind, topic, {})) imu(topic, log_time_ns, in);
      break;
    case Kind::transforms:
      transforms(log_time_ns, in, topic.find("static") != std::string::npos);
      break;
    case Kind::other:
      break;
  }
}

bool RosMessages::chosen(Kind kind, const std::string& topic, const std::string& wanted) {
  if (!wanted.empty() && !same_topic(topic, wanted)) {
    passed_over_.emplace(topic, kind);
    return false;
  }
  const auto [taken, first] = taken_.emplace(kind, topic);
  if (taken->second == topic) return true;
  passed_over_.emplace(topic, kind);
  return false;
}

std::int64_t RosMessages::stamp(std::int32_t sec, std::uint32_t nanosec, std::int64_t log_time_ns) {
  if (sec == 0 && nanosec == 0) {
    ++unstamped_;
    return log_time_ns;
  }
  return std::int64_t{sec} * 1'000'000'000 + nanosec;
}

void RosMessages::laser_scan(const std::string& topic, std::int64_t log_time_ns, CdrReader& in) {
  const Header header = read_header(in);
  const double first = in.value<float>();
  (void)in.value<float>();  // angle_max follows from the number of beams
  const double step = in.value<float>();
  const double beam_s = in.value<float>();
  const double scan_s = in.value<float>();
  in.skip<float>(2);
  const auto ranges = in.sequence<float>();
  const auto intensities = in.sequence<float>();
  if (ranges.empty() || ranges.size() > most_beams || !std::isfinite(first) || !std::isfinite(step) ||
      step == 0 || std::abs(first) > 100 || std::abs(step) > 10)
    throw CdrError("a scan without beams or with impossible angles");
  ImportedScan scan;
  scan.stamp_ns = stamp(header.sec, header.nanosec, log_time_ns);
  scan.source = topic;
  scan.frame = header.frame.starts_with('/') ? header.frame.substr(1) : header.frame;
  scan.geometry.first_rad = first;
  scan.geometry.step_rad = step;
  // The time between beams says more than the time between scans: some drivers give only one of them.
  // Drivers that leave the time of a beam out give that of a whole turn.
  const double turn = std::abs(scan.geometry.step_rad) * static_cast<double>(ranges.size()) / (2 * fit::pi);
  const double sweep_s =
      beam_s > 0 ? beam_s * static_cast<double>(ranges.size()) : scan_s * std::min(1.0, turn);
  if (std::isfinite(sweep_s) && sweep_s > 0 && sweep_s < 100) scan.geometry.scan_s = sweep_s;
  range_mm_.clear();
  for (const float range_m : ranges) {
    const double mm = range_m * 1000.0;
    too_far_ += std::isfinite(mm) && mm >= fit::first_error_code_mm ? 1 : 0;
    range_mm_.push_back(range_of(mm));
  }
  intensity_.clear();
  if (intensities.size() == ranges.size())
    for (const float level : intensities) intensity_.push_back(intensity_of(level));
  scan.range_mm = range_mm_;
  scan.intensity = intensity_;
  sink_.scan(scan);
}

void RosMessages::odometry(const std::string& topic, std::int64_t log_time_ns, CdrReader& in) {
  const Header header = read_header(in);
  std::string tracked(in.text());
  if (tracked.starts_with('/')) tracked.erase(0, 1);
  const double x = in.value<double>(), y = in.value<double>();
  (void)in.value<double>();
  const double qx = in.value<double>(), qy = in.value<double>(), qz = in.value<double>(),
               qw = in.value<double>();
  fit::TrackPose pose;
  pose.x_mm = x * 1000;
  pose.y_mm = y * 1000;
  pose.heading_rad = yaw_of(qw, qx, qy, qz);
  if (!std::isfinite(*pose.x_mm + *pose.y_mm + *pose.heading_rad))
    throw CdrError("a pose that is not a number");
  sink_.pose(stamp(header.sec, header.nanosec, log_time_ns), topic, tracked, pose);
}

void RosMessages::joint_state(const std::string& topic, std::int64_t log_time_ns, CdrReader& in) {
  const Header header = read_header(in);
  std::vector<std::string> names(std::min<std::size_t>(in.length(4), 1000));
  for (auto& name : names) name = in.text();
  const auto positions = in.sequence<double>();
  const std::size_t left = wheel_index(names, options_.left_wheel, "left");
  const std::size_t right = wheel_index(names, options_.right_wheel, "right");
  if (left >= positions.size() || right >= positions.size()) return;  // joints of an arm, say
  if (!chosen(Kind::joints, topic, {})) return;
  fit::TrackPose pose;
  pose.wheel_left_rad = positions[left];
  pose.wheel_right_rad = positions[right];
  if (!std::isfinite(positions[left] + positions[right]))
    throw CdrError("a wheel angle that is not a number");
  sink_.pose(stamp(header.sec, header.nanosec, log_time_ns), topic, {}, pose);
}

void RosMessages::imu(const std::string& topic, std::int64_t log_time_ns, CdrReader& in) {
  const Header header = read_header(in);
  const double qx = in.value<double>(), qy = in.value<double>(), qz = in.value<double>(),
               qw = in.value<double>();
  const double covariance = in.value<double>();
  in.skip<double>(8 + 2);
  const double rate = in.value<double>();
  // A unit without orientation says so by -1 in the first place of the covariance (sensor_msgs/Imu).
  const double yaw = yaw_of(qw, qx, qy, qz);
  if (covariance == -1 || !std::isfinite(yaw) || !std::isfinite(rate)) return;
  sink_.imu(stamp(header.sec, header.nanosec, log_time_ns), topic, yaw, rate);
}

void RosMessages::transforms(std::int64_t log_time_ns, CdrReader& in, bool fixed) {
  const std::size_t count = std::min<std::size_t>(in.length(60), 10'000);
  for (std::size_t i = 0; i < count; ++i) {
    ImportedTransform transform;
    const Header header = read_header(in);
    transform.parent = header.frame;
    transform.child = in.text();
    for (std::string* name : {&transform.parent, &transform.child})
      if (name->starts_with('/')) name->erase(0, 1);  // as ROS 1 wrote them before 2014
    transform.x_mm = in.value<double>() * 1000;
    transform.y_mm = in.value<double>() * 1000;
    transform.z_mm = in.value<double>() * 1000;
    transform.qx = in.value<double>();
    transform.qy = in.value<double>();
    transform.qz = in.value<double>();
    transform.qw = in.value<double>();
    if (fixed) {
      sink_.transform(transform);
      continue;
    }
    if (moving_.size() >= most_frames && !moving_.contains(transform.child)) continue;
    auto& seen = moving_[transform.child];
    const std::int64_t at_ns = stamp(header.sec, header.nanosec, log_time_ns);
    // One that has not moved is kept once, with how long it stood.
    if (!seen.empty() && same_place(seen.back().transform, transform))
      seen.back().until_ns = at_ns;
    else if (seen.size() < most_moves)
      seen.push_back({at_ns, at_ns, std::move(transform)});
  }
}

void RosMessages::finish_transforms() {
  for (const auto& [child, seen] : moving_) {
    if (seen.size() == 1) {
      sink_.transform(seen.front().transform);
      continue;
    }
    const std::string& parent = seen.front().transform.parent;
    if (taken_.contains(Kind::odometry) || !parent.ends_with("odom")) continue;
    taken_.emplace(Kind::odometry, "/tf");
    sink_.note("The bag holds no nav_msgs/Odometry: the transform from " + parent + " to " + child +
               " was used as the odometry.");
    for (const auto& [from_ns, until_ns, at] : seen) {
      fit::TrackPose pose;
      pose.x_mm = at.x_mm;
      pose.y_mm = at.y_mm;
      pose.heading_rad = yaw_of(at.qw, at.qx, at.qy, at.qz);
      if (!std::isfinite(*pose.x_mm + *pose.y_mm + *pose.heading_rad)) continue;
      sink_.pose(from_ns, "/tf", child, pose);
      if (until_ns > from_ns) sink_.pose(until_ns, "/tf", child, pose);
    }
  }
}

void RosMessages::finish() {
  finish_transforms();
  for (const auto& [topic, kind] : passed_over_) {
    const std::string option = kind == Kind::scan ? " Use --topic " + topic + " to take it instead."
                               : kind == Kind::odometry
                                   ? " Use --odometry-topic " + topic + " to take it instead."
                                   : "";
    sink_.note("Topic " + topic + " was left out: another of its kind was used." + option);
  }
  for (const auto& [topic, count] : faulty_)
    sink_.note(std::to_string(count) + " messages on " + topic +
               " were truncated or implausible and left out.");
  if (unstamped_ > 0)
    sink_.note(std::to_string(unstamped_) +
               " messages carry no time of their own; the recorder's time was used, which jitters.");
  if (too_far_ > 0)
    sink_.note(std::to_string(too_far_) +
               " ranges of 65.5 m or more were treated as no echo: a session cannot hold them.");
  if (messages_ == 0) {
    sink_.note("The bag holds no messages.");
  } else if (!taken_.count(Kind::scan)) {
    std::string types;
    for (const auto& type : types_seen_) types += (types.empty() ? "" : ", ") + type;
    sink_.note("The bag holds no sensor_msgs/LaserScan" +
               (options_.scan_topic.empty() ? std::string() : " on topic " + options_.scan_topic) +
               ". It holds: " + types + ".");
  }
}

}  // namespace rig
