// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "fit/bench/bench.hpp"

namespace fit {

/// One capture's circumstances (table `capture` of docs/reference/session.md), angles in radians.
struct CaptureInfo {
  std::int64_t id = 0;
  std::string step;
  std::int64_t started_us = 0;
  double stage_rad = 0;
  std::optional<double> stage_readback_rad;
  int approach = 0;
  std::optional<std::string> target;
  double target_shift_mm = 0;
  std::optional<double> reflectance;
  std::optional<double> temperature_c;
  std::optional<double> since_power_on_s;
  double stage_rate_rad_s = 0;
  int first_step = 0, last_step = 0, cluster = 1;

  /// Values per scan: one for each step, or for each cluster of steps.
  [[nodiscard]] int beams() const { return (last_step - first_step) / cluster + 1; }
  /// The step that value k of a scan stands for: the middle of its cluster, the last of which may be short.
  [[nodiscard]] double step_of(int k) const {
    const int first = first_step + k * cluster;
    return (first + std::min(first + cluster - 1, std::max(first, last_step))) / 2.0;
  }
};

/// Whether the stage turns while it records, so that every scan has its own stage angle.
[[nodiscard]] inline bool is_turning(const CaptureInfo& capture) {
  return std::abs(capture.stage_rate_rad_s) > 1e-9;
}

/// Own geometry of one scan, for lidars whose scans differ (the `scan_geometry` table).
struct ScanGeometry {
  double first_rad = 0, step_rad = 0;
  std::optional<double> scan_s;
};

/// Where the beams of a scan point, in the lidar's frame: by the scan's own geometry where it has one, else
/// by the lidar's steps, a cluster's value standing for the middle of its steps. The one rule for all who
/// place a beam; it borrows what it is made of.
class BeamAngles {
 public:
  BeamAngles(const LidarGeometry& lidar, const CaptureInfo& capture, const std::optional<ScanGeometry>& own)
      : lidar_(lidar), capture_(capture), own_(own) {}
  [[nodiscard]] double at_rad(std::size_t k) const {
    return own_ ? own_->first_rad + static_cast<double>(k) * own_->step_rad
                : lidar_.beam_angle(capture_.step_of(static_cast<int>(k)));
  }
  /// For formats that know evenly spaced beams only: the last cluster of a scan may be short, and lies a
  /// little before its place then.
  [[nodiscard]] double first_rad() const { return at_rad(0); }
  [[nodiscard]] double step_rad() const { return own_ ? own_->step_rad : lidar_.step_rad * capture_.cluster; }

 private:
  const LidarGeometry& lidar_;
  const CaptureInfo& capture_;
  const std::optional<ScanGeometry>& own_;
};

/// One scan, borrowed: valid only during the call that hands it over.
struct ScanView {
  std::int64_t seq = 0;
  std::int64_t device_ms = 0;
  std::int64_t host_us = 0;
  std::span<const std::uint16_t> range_mm;   ///< 0 = no echo or an error code.
  std::span<const std::uint16_t> intensity;  ///< Empty when not recorded.
  std::optional<ScanGeometry> geometry;
};

/// Odometry or stage track of a moving session (the `pose` table).
struct TrackPose {
  std::int64_t host_us = 0;
  std::optional<double> x_mm, y_mm, heading_rad, wheel_left_rad, wheel_right_rad, stage_rad;
};

/// A recording that can be walked scan by scan without holding all of it in memory. `rig` reads sessions into
/// this shape; tests and simulators make it directly.
class Recording {
 public:
  virtual ~Recording() = default;
  [[nodiscard]] virtual const Bench& bench() const = 0;
  [[nodiscard]] virtual const std::vector<CaptureInfo>& captures() const = 0;
  /// Calls `visit` for every scan of the capture at `index` in captures(), in order of seq.
  virtual void for_each_scan(std::size_t index, const std::function<void(const ScanView&)>& visit) const = 0;
  [[nodiscard]] virtual const std::vector<TrackPose>& track() const = 0;
};

/// All that another recording says, which it borrows: what differs from it in one respect derives from this.
class Forwarded : public Recording {
 public:
  explicit Forwarded(const Recording& of) : of_(of) {}
  [[nodiscard]] const Bench& bench() const override { return of_.bench(); }
  [[nodiscard]] const std::vector<CaptureInfo>& captures() const override { return of_.captures(); }
  void for_each_scan(std::size_t index, const std::function<void(const ScanView&)>& visit) const override {
    of_.for_each_scan(index, visit);
  }
  [[nodiscard]] const std::vector<TrackPose>& track() const override { return of_.track(); }

 private:
  const Recording& of_;
};

}  // namespace fit
