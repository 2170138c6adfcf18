// SPDX-License-Identifier: MIT
#include "rig/export/bag_messages.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <ctime>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "fit/echo.hpp"
#include "rig/session/deskewed_scans.hpp"
#include "rig/session/session_dates.hpp"

namespace rig {
namespace {

static_assert(std::endian::native == std::endian::little, "our CDR is little-endian");

/// One message in CDR: values aligned to their own size, counted from behind the four bytes of encapsulation.
class CdrWriter {
 public:
  template <class T>
  CdrWriter& add(T value) {
    while ((bytes_.size() - 4) % sizeof(T)) bytes_ += '\0';
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
    return *this;
  }
  CdrWriter& text(const std::string& value) {
    add(static_cast<std::uint32_t>(value.size() + 1));
    bytes_ += value + '\0';
    return *this;
  }
  CdrWriter& stamp(std::uint64_t time_ns) {
    add(static_cast<std::int32_t>(time_ns / 1'000'000'000));
    return add(static_cast<std::uint32_t>(time_ns % 1'000'000'000));
  }
  template <class T>
  CdrWriter& sequence(const std::vector<T>& values) {
    add(static_cast<std::uint32_t>(values.size()));
    for (const T value : values) add(value);
    return *this;
  }
  CdrWriter& header(std::uint64_t time_ns, const std::string& frame) { return stamp(time_ns).text(frame); }
  CdrWriter& zeros(int count) {
    for (int i = 0; i < count; ++i) add(0.0);
    return *this;
  }
  CdrWriter& quaternion(double yaw_rad) {
    return zeros(2).add(std::sin(yaw_rad / 2)).add(std::cos(yaw_rad / 2));
  }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_{"\x00\x01\x00\x00", 4};
};

const std::string separator = "\n" + std::string(80, '=') + "\n";
const std::string header_definition = separator +
                                      "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id" +
                                      separator + "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";
const std::string scan_definition =
    "std_msgs/Header header\nfloat32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\n"
    "float32 time_increment\nfloat32 scan_time\nfloat32 range_min\nfloat32 range_max\n"
    "float32[] ranges\nfloat32[] intensities\n" +
    header_definition;
const std::string joint_definition =
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n" +
    header_definition;
const std::string quaternion_definition =
    separator + "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w";
const std::string vector_definition =
    separator + "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z";
const std::string transforms_definition =
    "geometry_msgs/TransformStamped[] transforms" + separator +
    "MSG: geometry_msgs/TransformStamped\nstd_msgs/Header header\nstring child_frame_id\n"
    "geometry_msgs/Transform transform" +
    separator +
    "MSG: geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation" +
    vector_definition + quaternion_definition + header_definition;
const std::string odometry_definition =
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
    "geometry_msgs/TwistWithCovariance twist" +
    separator + "MSG: geometry_msgs/PoseWithCovariance\ngeometry_msgs/Pose pose\nfloat64[36] covariance" +
    separator +
    "MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation" +
    separator + "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z" + quaternion_definition +
    separator + "MSG: geometry_msgs/TwistWithCovariance\ngeometry_msgs/Twist twist\nfloat64[36] covariance" +
    separator + "MSG: geometry_msgs/Twist\ngeometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular" +
    vector_definition + header_definition;
const std::string points_definition =
    "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool "
    "is_bigendian\n"
    "uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense" +
    separator +
    "MSG: sensor_msgs/PointField\nuint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\n"
    "uint8 INT32=5\nuint8 UINT32=6\nuint8 FLOAT32=7\nuint8 FLOAT64=8\nstring name\nuint32 offset\n"
    "uint8 datatype\nuint32 count" +
    header_definition;

/// Nanoseconds of the Unix epoch at which what the session holds was measured; 0 when it does not say.
std::int64_t begin_ns(const SessionStore& session) {
  if (const auto unix_us = epoch_unix_us(session)) return *unix_us * 1000;
  const std::string text = dates_of(session).measured_utc;
  std::tm utc{};
  if (!strptime(text.c_str(), "%Y-%m-%dT%H:%M:%S", &utc)) return 0;
  return std::int64_t{timegm(&utc)} * 1'000'000'000;
}

std::string laser_scan(const fit::LidarGeometry& lidar, const fit::CaptureInfo& capture,
                       const fit::ScanView& scan, std::uint64_t time_ns) {
  const fit::BeamAngles angles(lidar, capture, scan.geometry);
  const double first = angles.first_rad(), step = angles.step_rad();
  const auto beams = static_cast<double>(scan.range_mm.size());
  const double last = first + step * (beams - 1);
  // An imported scan knows how long its beams took, of which the turn may be only a part.
  const double part_of_turn = std::abs(step) / (2 * fit::pi);
  const bool own_time = scan.geometry && scan.geometry->scan_s && beams > 0 && part_of_turn > 0;
  const double turn_s = own_time ? *scan.geometry->scan_s / (part_of_turn * beams) : 1 / lidar.scan_hz;
  std::vector<float> ranges, intensities(scan.intensity.begin(), scan.intensity.end());
  for (const std::uint16_t range : scan.range_mm)  // REP 117: no echo is +infinity
    ranges.push_back(range ? static_cast<float>(range) * 1e-3F : std::numeric_limits<float>::infinity());
  CdrWriter out;
  out.header(time_ns, "laser");
  constexpr double nearest_m = 0.02, farthest_m = fit::first_error_code_mm * 1e-3;
  for (const double value : {first, last, step, part_of_turn * turn_s, turn_s, nearest_m, farthest_m})
    out.add(static_cast<float>(value));
  return out.sequence(ranges).sequence(intensities).bytes();
}

std::string stage_state(const fit::CaptureInfo& capture, const fit::ScanView& scan, std::uint64_t time_ns) {
  const double since_s = static_cast<double>(scan.host_us - capture.started_us) * 1e-6;
  CdrWriter out;
  out.header(time_ns, "").add(std::uint32_t{1}).text("stage");
  out.sequence(std::vector<double>{capture.stage_rad + capture.stage_rate_rad_s * since_s});
  out.sequence(std::vector<double>{capture.stage_rate_rad_s});
  return out.add(std::uint32_t{0}).bytes();
}

std::string wheel_state(const fit::TrackPose& at, std::uint64_t time_ns) {
  CdrWriter out;
  out.header(time_ns, "").add(std::uint32_t{2}).text("left_wheel_joint").text("right_wheel_joint");
  out.sequence(std::vector<double>{*at.wheel_left_rad, *at.wheel_right_rad});
  return out.add(std::uint32_t{0}).add(std::uint32_t{0}).bytes();
}

std::string transform(const char* parent, const char* child, const fit::Pose2& pose, std::uint64_t time_ns) {
  CdrWriter out;
  out.add(std::uint32_t{1}).header(time_ns, parent).text(child);
  return out.add(pose.x_mm / 1000).add(pose.y_mm / 1000).add(0.0).quaternion(pose.heading_rad).bytes();
}

/// The twist is what the pose before tells; unknown covariances are zero, as nav_msgs/Odometry has them.
std::string odometry(const fit::TimedPose& at, const fit::TimedPose& before, std::uint64_t time_ns) {
  CdrWriter out;
  out.header(time_ns, "odom").text("base_link");
  out.add(at.pose.x_mm / 1000).add(at.pose.y_mm / 1000).add(0.0).quaternion(at.pose.heading_rad).zeros(36);
  const double s = at.time_s - before.time_s;
  const fit::Pose2 step = before.pose.inverse() * at.pose;
  const double rate = s > 0 ? 1 / s : 0;
  out.add(step.x_mm / 1000 * rate).add(step.y_mm / 1000 * rate).zeros(3);
  return out.add(fit::wrap_angle(step.heading_rad) * rate).zeros(36).bytes();
}

/// Points without echo are left out.
std::string point_cloud(const DeskewedScan& deskewed, const fit::ScanView& scan, std::uint64_t time_ns) {
  const bool lit = !scan.intensity.empty();
  std::vector<float> values;
  std::uint32_t count = 0;
  for (std::size_t k = 0; 2 * k + 1 < deskewed.points.size(); ++k) {
    const float x = deskewed.points[2 * k], y = deskewed.points[2 * k + 1];
    if (std::isnan(x) || std::isnan(y)) continue;
    ++count;
    values.insert(values.end(), {x / 1000, y / 1000, 0.0F});
    if (lit) values.push_back(k < scan.intensity.size() ? static_cast<float>(scan.intensity[k]) : 0.0F);
  }
  constexpr std::uint8_t float32 = 7;
  CdrWriter out;
  out.header(time_ns, "laser").add(std::uint32_t{1}).add(count).add(std::uint32_t{lit ? 4U : 3U});
  std::uint32_t offset = 0;
  for (const char* name : {"x", "y", "z", "intensity"}) {
    if (offset == 12 && !lit) break;
    out.text(name).add(offset).add(float32).add(std::uint32_t{1});
    offset += 4;
  }
  out.add(std::uint8_t{0}).add(offset).add(offset * count).add(offset * count);
  for (const float value : values)
    for (const auto byte : std::bit_cast<std::array<std::uint8_t, 4>>(value)) out.add(byte);
  return out.add(std::uint8_t{1}).bytes();
}

/// Writes one session; what of a track lies before a scan goes before it.
class BagOfSession {
 public:
  BagOfSession(const SessionStore& session, BagSink& out)
      : deskewed_(session), out_(out), recording_(session.recording()), begin_ns_(begin_ns(session)) {
    const fit::Mount& mount = recording_->bench().lidar.mount;
    lidar_ = {mount.x_mm.value, mount.y_mm.value, mount.yaw_rad.value};
    track_ = recording_->track();
    std::ranges::stable_sort(track_, {}, &fit::TrackPose::host_us);
  }

  void write() {
    const bool deskewed = deskewed_.any();
    const bool placed = deskewed || std::ranges::any_of(track_, [](const auto& at) { return is_placed(at); });
    scans_ = out_.add_channel({"/scan", "sensor_msgs/msg/LaserScan", scan_definition});
    joints_ = out_.add_channel({"/joint_states", "sensor_msgs/msg/JointState", joint_definition});
    if (placed) {
      tf_ = out_.add_channel({"/tf", "tf2_msgs/msg/TFMessage", transforms_definition});
      odometry_ = out_.add_channel({"/odom", "nav_msgs/msg/Odometry", odometry_definition});
      const auto fixed =
          out_.add_channel({"/tf_static", "tf2_msgs/msg/TFMessage", transforms_definition, true});
      const std::uint64_t time = first_ns();
      out_.add_message(fixed, time, transform("base_link", "laser", lidar_, time));
    }
    if (deskewed) points_ = out_.add_channel({"/points", "sensor_msgs/msg/PointCloud2", points_definition});
    for (std::size_t i = 0; i < recording_->captures().size(); ++i) {
      const fit::CaptureInfo& capture = recording_->captures()[i];
      const auto straight = deskewed_.scans_of(capture.id);
      recording_->for_each_scan(i, [&](const fit::ScanView& scan) {
        track_until(scan.host_us, !deskewed);
        const DeskewedScan* corrected = straight ? straight->of(scan.seq) : nullptr;
        add_scan(capture, scan, corrected);
      });
    }
    track_until(std::numeric_limits<std::int64_t>::max(), !deskewed);
  }

 private:
  static bool is_placed(const fit::TrackPose& at) { return at.x_mm && at.y_mm && at.heading_rad; }

  [[nodiscard]] std::uint64_t time_ns(std::int64_t host_us) const {
    return static_cast<std::uint64_t>(std::max<std::int64_t>(0, begin_ns_ + host_us * 1000));
  }
  [[nodiscard]] std::uint64_t first_ns() const {
    return time_ns(track_.empty() ? 0 : std::min<std::int64_t>(0, track_.front().host_us));
  }

  void track_until(std::int64_t host_us, bool with_poses) {
    for (; next_ < track_.size() && track_[next_].host_us <= host_us; ++next_) {
      const fit::TrackPose& at = track_[next_];
      const std::uint64_t time = time_ns(at.host_us);
      if (at.wheel_left_rad && at.wheel_right_rad) out_.add_message(joints_, time, wheel_state(at, time));
      if (with_poses && is_placed(at)) place(at.host_us, {*at.x_mm, *at.y_mm, *at.heading_rad});
    }
  }

  void place(std::int64_t host_us, const fit::Pose2& pose) {
    const std::uint64_t time = time_ns(host_us);
    const fit::TimedPose now{static_cast<double>(host_us) * 1e-6, pose};
    out_.add_message(tf_, time, transform("odom", "base_link", pose, time));
    out_.add_message(odometry_, time, odometry(now, before_.value_or(now), time));
    before_ = now;
  }

  void add_scan(const fit::CaptureInfo& capture, const fit::ScanView& scan, const DeskewedScan* corrected) {
    const std::uint64_t time = time_ns(scan.host_us);
    if (corrected) place(scan.host_us, corrected->lidar * lidar_.inverse());
    out_.add_message(scans_, time, laser_scan(recording_->bench().lidar, capture, scan, time));
    out_.add_message(joints_, time, stage_state(capture, scan, time));
    if (corrected) out_.add_message(points_, time, point_cloud(*corrected, scan, time));
  }

  DeskewedSession deskewed_;
  BagSink& out_;
  std::unique_ptr<fit::Recording> recording_;
  std::int64_t begin_ns_;
  fit::Pose2 lidar_;
  std::vector<fit::TrackPose> track_;
  std::size_t next_ = 0;
  std::optional<fit::TimedPose> before_;
  std::uint16_t scans_ = 0, joints_ = 0, tf_ = 0, odometry_ = 0, points_ = 0;
};

}  // namespace

void write_bag(const SessionStore& session, BagSink& out) { BagOfSession(session, out).write(); }

}  // namespace rig
