// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/bench/radiometer.hpp"
#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain::model {

/// The mean intensity of one cell, or of a few neighbouring ones, against a law.
struct Reading {
  Circumstances
      at;  ///< Of the middle cell; `intensity` as the law has it: what was measured would be its own cause.
  int capture = 0;
  int surface = 0;      ///< Target and grey: what shares one nominal reflectance.
  double off = 0;       ///< Logarithm of the counts over the law's.
  double sigma = 0.01;  ///< Its standard uncertainty.
  double per_echo = 1;  ///< d ln(counts) / d ln(echo) of the law's receiver there.
};

/// About `most` of them, as many of every capture as of any other; none where too few cells came back bright
/// enough. Their uncertainties are by how neighbours scatter, one by one and a dozen together.
[[nodiscard]] std::vector<Reading> readings_of(const Reduced& reduced, const IntensityLaw& law,
                                               std::size_t most);

/// Relative noise of one sample: the middle one of all cells; 0 where too few show it.
[[nodiscard]] double sample_noise(const Reduced& reduced);

}  // namespace fit::explain::model
