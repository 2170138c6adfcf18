// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Dense>
#include <vector>

#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain::reduction {

/// How strong an echo is expected, counts, by the echoes of which counts are known: a power of the range, of
/// the incidence's cosine and of the surface's reflectance (the radar equation, with exponents of this
/// receiver).
class ExpectedEcho {
 public:
  /// Of echoes whose intensities are known.
  explicit ExpectedEcho(const std::vector<const Circumstances*>& known);
  /// Unknown where none is.
  [[nodiscard]] double operator()(const Circumstances& at) const;

 private:
  [[nodiscard]] static Eigen::Vector4d powers(const Circumstances& at);

  Eigen::Vector4d exponents_;
};

/// Cells that show the most counts of all, alike, though geometry makes their echoes differ: counts end
/// there.
struct EndOfCounts {
  double counts = 0;
  int cells = 0, below = 0;
  double weakest = 1e300, strongest = 0;  ///< Power of their echoes, any unit.

  explicit EndOfCounts(const Reduced& reduced);
  [[nodiscard]] bool is_reached() const;
  [[nodiscard]] bool is_at_it(const Cell& cell) const;
};

/// Where counts end the echo is as strong as the others make it expected, and no weaker than the end: what
/// follows the echo goes on beyond it.
void expect_beyond_end_of_counts(Reduced& reduced);

}  // namespace fit::explain::reduction
