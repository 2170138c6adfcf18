// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "fit/range/correction.hpp"
#include "fit/range/family.hpp"

namespace fit {

/// One capture of a flat target: its true distance, and what the beam square on it measured.
struct RangePoint {
  double true_mm = 0;
  double measured_mm = 0;
  double u_mm = 1;  ///< Of the measured mean.
  double intensity = 0;
  double sd_mm = 0, sd_counts = 0;  ///< Of one sample.
  bool for_intensity = false;       ///< Taken at the distance at which surfaces were changed (experiment A1).
  bool for_distance = false;        ///< One of the same surface at many distances (A2).
  [[nodiscard]] double error_mm() const { return measured_mm - true_mm; }
};

/// Sorts captures into the two experiments by what was changed: A1 is the true distance (within 2 mm) at
/// which there are most captures, if at least four of them differ in intensity by 3 % or more; A2 is
/// everything when there are three distances or more, but of A1's captures only the one whose intensity is
/// nearest to that of the next distance. `least` is below 4 only in tests.
void sort_into_experiments(std::vector<RangePoint>& points);

/// Of fewer captures the scatter between them is not seen: the bench file's placement stands for it.
inline constexpr long fewest_that_scatter = 7;

struct RangeOptions {
  std::string intensity_family, distance_family;  ///< Empty: what predicts best.
  double reference_intensity = 0;                 ///< 0: the largest of A1.
  double placement_u_mm = 0;  ///< Used as scatter where there are too few points to see it.
  double common_u_mm = 0;     ///< Of the true distances, the same error in all of them.
};

/// Errors of echo strength and of distance, from the points of one selection of samples.
struct RangeCalibration {
  std::vector<FamilyFit> intensity_table,
      distance_table;                    ///< As the paper's tables; sorted by held-out error.
  std::optional<Correction> joint;       ///< Both at once; also when only one of the two could be fitted.
  std::optional<Correction> sequential;  ///< The paper's way: A1 first, then A2 corrected by it.
  long points_intensity = 0, points_distance = 0;            ///< In either experiment.
  double scatter_intensity_mm = 0, scatter_distance_mm = 0;  ///< Beyond the means' own uncertainty.
  double rms_before_mm = 0, rms_after_mm = 0;                ///< Of the points' errors.
  double held_out_mm = 0;  ///< Of the joint model, each tenth of the points predicted from the others.
  double condition = 0;    ///< Of the joint model.
  double correlation = 0;  ///< Largest canonical correlation of intensity and distance parts.
  std::vector<std::string> identifiability;  ///< What these points cannot separate.
  std::vector<std::string> notes;
  std::string why_not;  ///< Why there is no correction.
};

[[nodiscard]] RangeCalibration calibrate_range(std::vector<RangePoint> points,
                                               const RangeOptions& options = {});

}  // namespace fit
