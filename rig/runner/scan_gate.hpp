// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "rig/procedure/step.hpp"
#include "rig/runner/lidar_source.hpp"

namespace rig {

// Scans that do not belong to the capture: ten seconds of them at 40 Hz, longer where the stream skips some.
constexpr int refusals_in_a_row = 400;
constexpr double longest_gap_ms = 3.6e6;  // No stream is silent so long: a stamp beyond it is wrong.

/// Decides for every scan of a stream whether it belongs to the capture.
class ScanGate {
 public:
  ScanGate(const CaptureRequest& request, double scan_hz)
      : request_(request), half_scan_ms_(500.0 / scan_hz) {}

  /// A stream begins anew: its first scan may have begun before the command. Scans of before `seen_ms`, the
  /// latest stamp since the lidar was connected, are an earlier stream's; without one it has just been
  /// connected, and its stamps may have begun anew.
  void restart(std::optional<std::uint64_t> seen_ms) {
    if (!seen_ms) taken_ms_.reset();
    fresh_ = true;
    last_ms_.reset();
    seen_ms_ = seen_ms;
    refused_in_a_row_ = 0;
  }

  /// `settled_us`: host time before which the stage had not settled, or 0 if host times say nothing.
  bool takes(const lidar::Scan& scan, std::int64_t settled_us) {
    if (!fits(scan)) return refuse();
    if (std::exchange(fresh_, false)) return false;
    if (settled_us != 0 && scan.host_us < settled_us) return refuse();
    if (seen_ms_ && scan.device_ms <= *seen_ms_) return refuse();
    const auto stamp = static_cast<double>(scan.device_ms);
    if (last_ms_ && (stamp <= *last_ms_ || stamp > *last_ms_ + longest_gap_ms)) return refuse();
    last_ms_ = stamp;
    refused_in_a_row_ = 0;
    if (taken_ms_ && stamp < *taken_ms_ + 1000 * request_.spacing_s - half_scan_ms_) return false;
    taken_ms_ = stamp;
    return true;
  }

  [[nodiscard]] bool hopeless() const { return refused_in_a_row_ > refusals_in_a_row; }

 private:
  bool fits(const lidar::Scan& scan) const {
    const auto beams =
        static_cast<std::size_t>((request_.last_step - request_.first_step) / request_.cluster + 1);
    return scan.first_step == request_.first_step && scan.last_step == request_.last_step &&
           scan.cluster == request_.cluster && scan.range_mm.size() == beams &&
           (scan.intensity.empty() || scan.intensity.size() == beams);
  }
  bool refuse() {
    ++refused_in_a_row_;
    return false;
  }

  const CaptureRequest& request_;
  double half_scan_ms_;
  bool fresh_ = true;
  std::optional<std::uint64_t> seen_ms_;
  std::optional<double> last_ms_, taken_ms_;
  int refused_in_a_row_ = 0;
};

/// The most scans that the device itself may leave out and still serve the spacing; SCIP allows 9.
int skip_for(double spacing_s, double scan_hz);
LidarStream stream_for(const CaptureRequest& request, int skip);
/// All steps of the bench's lidar.
LidarStream whole_scan(const fit::LidarGeometry& lidar);

}  // namespace rig
