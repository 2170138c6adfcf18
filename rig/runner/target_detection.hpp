// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "fit/bench/bench.hpp"

namespace rig {

/// Where the beams of the lidar at stage angle `stage_rad` meet `target`: expected ranges by beam, NaN for
/// beams that miss it or pass within a tenth of its width from an end. The other targets are not in the way.
[[nodiscard]] std::vector<double> expected_ranges_mm(const fit::Bench& bench, const fit::Target& target,
                                                     double stage_rad);

/// The same target, moved along its normal away from the stage's axis.
[[nodiscard]] fit::Target shifted(fit::Target target, double shift_mm);

/// Distance of the target's plane from the stage's axis.
[[nodiscard]] double distance_mm(const fit::Target& target);

/// Medians over some scans, one a step of the lidar from 0 on; NaN where most scans had no echo.
struct BeamMedians {
  std::vector<double> range_mm, intensity;
};

/// What the beams on a target show.
struct TargetDetection {
  enum class Outcome { in_place, misplaced, undetected, out_of_view };
  Outcome outcome = Outcome::out_of_view;
  std::string words;      ///< What is seen, as a clause: "it is seen 390 mm farther away, at 1790 mm (...)".
  double to_go_mm = 0;    ///< Seen minus asked along the normal; positive is too far away.
  double seen_mm = 0;     ///< Distance of what is seen from the stage's axis, along the normal.
  double allowed_mm = 0;  ///< Largest difference that the stated uncertainties explain.
  double intensity = 0;   ///< Median of the beams on the target; NaN if none was measured.

  [[nodiscard]] bool good() const { return outcome == Outcome::in_place || outcome == Outcome::out_of_view; }
};

/// How far a range may be off before the lidar is calibrated: `lidar.largest_error_mm` of the bench file,
/// else the data sheet's of an UST-10LX.
[[nodiscard]] double largest_range_error_mm(const fit::Bench& bench);

/// Compares what is seen with `target` standing where it says, at stage angle `stage_rad`. Allowed is the
/// lidar's accuracy and three standard uncertainties of target and mount, or `tolerance_mm`. Of `others`,
/// those that stand nearer hide it.
[[nodiscard]] TargetDetection detect_target(const fit::Bench& bench, const fit::Target& target,
                                            const std::vector<fit::Target>& others, double stage_rad,
                                            const BeamMedians& seen, std::optional<double> tolerance_mm = {});

}  // namespace rig
