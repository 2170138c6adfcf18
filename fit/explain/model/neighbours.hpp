// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/reduction/reduce.hpp"

/// Noise that neighbouring beams share, as heat shimmer makes it: sums over many beams scatter more than
/// those of independent ones, and many beams say less of a variance than their number.
namespace fit::explain::model {

/// How sectors of the scans of one capture scatter beside the range and the angle that each scan has in
/// common, and beside what repeats from capture to capture.
struct SectorScatter {
  Circumstances at;
  int capture = 0;
  double square_mm2 = 0;    ///< Weighted sum of squares over the sectors of a scan, on average ...
  double expected_mm2 = 0;  ///< ... that of independent beams ...
  double n = 0;             ///< ... and how many degrees of freedom it has in all scans.
};

/// Of captures whose groups have at least so many scans.
[[nodiscard]] std::vector<SectorScatter> sector_scatter(const Reduced& reduced, int fewest_scans);

/// Variance of a sum over a sector by that of independent beams; 1 unless that is certain.
[[nodiscard]] double inflation_of_sums(const Reduced& reduced);
/// Variance of a sum over the beams of each target by that of independent beams; 1 where that is not certain.
[[nodiscard]] std::vector<double> inflation_of_targets(const Reduced& reduced);
/// How many samples say as much of their variance as one independent, normal one; 1 unless that is certain.
[[nodiscard]] double inflation_of_squares(const Reduced& reduced);

/// By how much more sample variances of neighbouring beams scatter than those of normal samples do, whose
/// degrees of freedom are worth so much; 1 unless that is certain. Of cells of 20 samples at most: a handful
/// does not show its own tails, which are far larger than any of its fourth moments (Joanes and Gill 1998).
[[nodiscard]] double inflation_of_variances(const Reduced& reduced, double worth);

/// Noise that every beam has by its own, the same in all captures: a random effect of beams.
struct NoiseOfBeams {
  double variance = 0;  ///< Of a beam's share in the variance of its neighbours; 0 unless that is certain.
  double captures = 0;  ///< That saw a beam, on average.

  /// What is left of a cell's degrees of freedom: all captures together know no more of a beam than its own.
  [[nodiscard]] double left_of(double freedom) const {
    return freedom / (1 + captures * variance * freedom / 2);
  }
};
/// By how beams lie off their neighbours, capture after capture; few that lie far off are something else.
[[nodiscard]] NoiseOfBeams noise_of_beams(const Reduced& reduced);

}  // namespace fit::explain::model
