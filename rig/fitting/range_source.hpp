// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "fit/range/range_calibration.hpp"
#include "fit/range/selection.hpp"
#include "fit/recording.hpp"
#include "rig/fitting/fitting.hpp"

namespace rig {

/// What one capture says of one target: the beam square on it, its selected samples, and the true distance.
struct RangeCapture {
  std::string label, target;
  double true_mm = 0;     ///< Along the normal, from bench and shift.
  double normal_deg = 0;  ///< Direction of the normal in the lidar's frame that was used.
  double u_normal_deg = 0;
  bool normal_from_data = false;
  double beam_deg = 0;        ///< Mean direction of the beam nearest to it.
  double oblique_mm = 0;      ///< Range along that beam less the distance along the normal.
  double u_placement_mm = 0;  ///< Of the target along its normal, radius and the normal's direction included.
  double u_mount_mm = 0;      ///< Of the lidar's place on the stage, along that normal.
  bool placed_anew = false;   ///< Its placement's error is its own.
  std::optional<double> reflectance, temperature_c;
  double beam_step_deg = 0;  ///< From one beam to the next.
  fit::SelectedMean paper, robust;
  double sd_counts = 0;  ///< Of one sample's intensity.
  long scans = 0;
  /// Standard uncertainty of the true distance.
  [[nodiscard]] double u_true_mm() const { return std::hypot(u_placement_mm, u_mount_mm); }
  /// Of what is the same in the true distances of all captures.
  [[nodiscard]] double u_common_mm() const { return placed_anew ? u_mount_mm : u_true_mm(); }
  [[nodiscard]] fit::RangePoint point(const fit::SelectedMean& mean) const {
    fit::RangePoint out;
    out.true_mm = true_mm, out.measured_mm = mean.mean_mm - oblique_mm;
    out.u_mm = mean.u_mm, out.intensity = mean.intensity;
    out.sd_mm = robust.sd_mm, out.sd_counts = sd_counts;
    return out;
  }
};

struct RangeSource {
  std::vector<RangeCapture> captures;
  std::vector<std::string> notes;           ///< Captures left out.
  std::vector<std::string> contradictions;  ///< Where the bench contradicts what was seen.
};

/// One RangeCapture for every capture of the sessions that looks squarely at a target with a known place.
/// Throws MeasurementError when there is none.
[[nodiscard]] RangeSource read_ranges(const std::vector<FitSource>& sources);

}  // namespace rig
