// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/range/correction.hpp"
#include "fit/range/family.hpp"
#include "fit/range/range_calibration.hpp"

namespace fit {

struct JointOptions {
  double scatter_intensity_mm = 0, scatter_distance_mm = 0;  ///< Of the points, beyond their own uncertainty.
  double reference_mm = 0, reference_counts = 0;             ///< Where either term is zero.
};

/// Zero, a curve over intensity and a curve over distance, fitted at once.
struct JointFit {
  Correction correction;
  double condition = 0;    ///< Of the model.
  double correlation = 0;  ///< Largest cosine between a curve of the one kind and one of the other.
  double held_out = 0;     ///< mm: each tenth of the points predicted from the others.
  bool ok = false;         ///< False where there are too few points, or no fit.
};

/// The families are those that the curves alone chose; their fits are where the search begins. The covariance
/// is widened where the points scatter by more than they state.
[[nodiscard]] JointFit fit_joint(const std::vector<RangePoint>& points, const FamilyFit& intensity,
                                 const FamilyFit& distance, const JointOptions& options);

}  // namespace fit
