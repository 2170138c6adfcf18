// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "fit/numeric/number_format.hpp"
#include "rig/errors.hpp"
#include "rig/import/import_session.hpp"
#include "rig/import/plausibility.hpp"
#include "rig/session/session_store.hpp"

namespace rig {

/// Where `child` sits on the robot: the chain of transforms up to `wanted`, or as far as it goes.
struct FrameInParent {
  std::string parent;
  Eigen::Isometry3d child_in_parent = Eigen::Isometry3d::Identity();
};

inline std::optional<FrameInParent> frame_in_parent(const std::map<std::string, ImportedTransform>& by_child,
                                                    const std::string& child, const std::string& wanted) {
  FrameInParent result;
  std::string at = child;
  for (std::size_t hops = 0; hops <= by_child.size() && at != wanted; ++hops) {
    const auto up = by_child.find(at);
    if (up == by_child.end()) break;
    const ImportedTransform& t = up->second;
    const Eigen::Quaterniond q(t.qw, t.qx, t.qy, t.qz);
    if (!(q.norm() > 0.1)) return std::nullopt;
    Eigen::Isometry3d step(q.normalized());
    step.translation() << t.x_mm, t.y_mm, t.z_mm;
    result.child_in_parent = step * result.child_in_parent;
    at = result.parent = t.parent;
  }
  if (result.parent.empty()) return std::nullopt;
  return result;
}

/// Writes what the importers read.
class SessionWriter : public ImportSink {
 public:
  SessionWriter(SessionStore& store, std::int64_t epoch_ns, const ImportRequest& request)
      : store_(store), epoch_ns_(epoch_ns), request_(request) {}

  /// Without circumstances for a file that holds no scans.
  void begin_file(const std::string& file, const std::optional<fit::CaptureInfo>& info) {
    file_ = file;
    seq_ = 0;
    plausibility_ = {};
    if (info) capture_ = store_.begin_capture(*info);
  }
  void end_file(std::optional<double> true_mm) {
    if (const auto why = plausibility_.impossible()) throw MeasurementError(file_ + ": " + *why);
    for (const auto& doubt : plausibility_.doubts(true_mm)) this->doubt(doubt);
    for (const auto& note : plausibility_.notes()) this->note(note);
    if (const auto hz = plausibility_.stamped_hz(); hz && timed_ == 0) stamped_hz_ = hz;
    if (capture_) {
      store_.commit_capture(*capture_);
      ++report_.captures;
    }
    capture_.reset();
  }
  /// What scans and track together cannot be.
  void end() {
    if (report_.scans == 0 || report_.poses == 0) return;
    if (first_pose_us_ > last_scan_us_ || last_pose_us_ < first_scan_us_)
      refuse_or_note("The wheels or poses (" + seconds(first_pose_us_) + " to " + seconds(last_pose_us_) +
                     " s after the first scan) and the scans (until " + seconds(last_scan_us_) +
                     " s) do not overlap in time: they need one clock.");
  }

  void scan(const ImportedScan& given) override {
    ImportedScan scan = given;
    if (const auto hz = request_.options.scan_hz)
      scan.geometry.scan_s =
          std::abs(scan.geometry.step_rad) * static_cast<double>(scan.range_mm.size()) / (2 * fit::pi * *hz);
    plausibility_.scan(scan);
    if (!capture_) return;  // The file has changed since it was looked at.
    fit::ScanView view;
    view.seq = seq_++;
    view.host_us = host_us(scan.stamp_ns);
    view.device_ms = view.host_us / 1000;
    view.range_mm = scan.range_mm;
    view.intensity = scan.intensity;
    view.geometry = scan.geometry;
    store_.add_scan(*capture_, view);
    first_scan_us_ = std::min(first_scan_us_, view.host_us);
    last_scan_us_ = std::max(last_scan_us_, view.host_us);
    frame_ = scan.frame;
    source_ = scan.source;
    ++report_.scans;
    most_beams_ = std::max(most_beams_, scan.range_mm.size());
    step_sum_ += scan.geometry.step_rad;
    first_sum_ += scan.geometry.first_rad;
    const double swept_rad = std::abs(scan.geometry.step_rad) * static_cast<double>(scan.range_mm.size());
    if (scan.geometry.scan_s && *scan.geometry.scan_s > 0 && swept_rad > 0) {
      turn_s_sum_ += *scan.geometry.scan_s * 2 * fit::pi / swept_rad;
      ++timed_;
    }
  }

  void pose(std::int64_t stamp_ns, const std::string&, const std::string& frame,
            const fit::TrackPose& pose) override {
    plausibility_.pose(stamp_ns, pose);
    fit::TrackPose placed = pose;
    placed.host_us = host_us(stamp_ns);
    store_.add_pose(placed);
    first_pose_us_ = std::min(first_pose_us_, placed.host_us);
    last_pose_us_ = std::max(last_pose_us_, placed.host_us);
    if (!frame.empty()) tracked_ = frame;
    ++report_.poses;
  }

  void imu(std::int64_t stamp_ns, const std::string&, double yaw_rad, double rate_rad_s) override {
    imu_.push_back({host_us(stamp_ns), yaw_rad, rate_rad_s});
  }

  void transform(const ImportedTransform& transform) override {
    if (transforms_.size() < 10'000) transforms_[transform.child] = transform;
  }

  void property(const std::string& key, const std::string& value) override { properties_[key] = value; }

  void note(const std::string& text) override {
    const std::string full = std::filesystem::path(file_).filename().string() + ": " + text;
    if (!said_.insert(full).second) return;
    report_.notes.push_back(full);
    store_.add_event(0, "warning", full);
  }

  void doubt(const std::string& text) override { refuse_or_note(file_ + ": " + text); }

  bool wants_more() const override { return true; }

  [[nodiscard]] std::string lidar_model() const {
    const auto model = properties_.find("model");
    return model != properties_.end() ? model->second : frame_.empty() ? "imported" : frame_;
  }
  [[nodiscard]] std::int64_t epoch_ns() const { return epoch_ns_; }
  [[nodiscard]] std::size_t most_beams() const { return most_beams_; }
  [[nodiscard]] double mean_first_rad() const { return first_sum_ / scans(); }
  [[nodiscard]] double mean_step_rad() const { return step_sum_ / scans(); }
  [[nodiscard]] double scan_hz() const {
    return timed_ > 0 && turn_s_sum_ > 0 ? static_cast<double>(timed_) / turn_s_sum_
                                         : stamped_hz_.value_or(10);
  }
  [[nodiscard]] const std::string& source() const { return source_; }
  [[nodiscard]] const std::map<std::string, std::string>& properties() const { return properties_; }
  [[nodiscard]] ImportReport& report() { return report_; }

  /// The lidar on the part of the robot that odometry tracks.
  [[nodiscard]] std::optional<FrameInParent> lidar_on_robot() const {
    return frame_in_parent(transforms_, frame_, tracked_.empty() ? "base_link" : tracked_);
  }
  [[nodiscard]] nlohmann::json transforms() const {
    nlohmann::json list = nlohmann::json::array();
    for (const auto& [child, t] : transforms_) {
      if (!std::isfinite(t.x_mm + t.y_mm + t.z_mm + t.qw + t.qx + t.qy + t.qz)) continue;
      list.push_back({{"parent", t.parent},
                      {"child", child},
                      {"x_mm", t.x_mm},
                      {"y_mm", t.y_mm},
                      {"z_mm", t.z_mm},
                      {"quaternion_wxyz", {t.qw, t.qx, t.qy, t.qz}}});
    }
    return list;
  }
  struct Heading {
    std::int64_t host_us;
    double yaw_rad, rate_rad_s;
  };
  [[nodiscard]] const std::vector<Heading>& imu() const { return imu_; }
  [[nodiscard]] const std::string& frame() const { return frame_; }

 private:
  [[nodiscard]] std::int64_t host_us(std::int64_t stamp_ns) const { return (stamp_ns - epoch_ns_) / 1000; }
  [[nodiscard]] double scans() const {
    return static_cast<double>(std::max<std::uint64_t>(1, report_.scans));
  }
  static std::string seconds(std::int64_t us) { return fit::format_fixed(1e-6 * static_cast<double>(us), 1); }

  void refuse_or_note(const std::string& text) {
    if (!request_.accept_doubts)
      throw MeasurementError(text + " Or import it as it is with --accept-doubts.");
    note("not plausible, and imported all the same: " + text);
  }

  SessionStore& store_;
  std::int64_t epoch_ns_;
  const ImportRequest& request_;
  Plausibility plausibility_;
  std::optional<double> stamped_hz_;
  std::string file_, frame_, source_, tracked_;
  std::optional<std::int64_t> capture_;
  std::int64_t seq_ = 0, first_scan_us_ = std::numeric_limits<std::int64_t>::max(),
               last_scan_us_ = -std::numeric_limits<std::int64_t>::max(),
               first_pose_us_ = std::numeric_limits<std::int64_t>::max(),
               last_pose_us_ = -std::numeric_limits<std::int64_t>::max();
  std::size_t most_beams_ = 0;
  double step_sum_ = 0, first_sum_ = 0, turn_s_sum_ = 0;
  std::uint64_t timed_ = 0;
  std::map<std::string, ImportedTransform> transforms_;
  std::map<std::string, std::string> properties_;
  std::vector<Heading> imu_;
  std::set<std::string> said_;
  ImportReport report_;
};

}  // namespace rig
