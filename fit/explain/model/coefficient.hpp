// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <limits>

namespace fit::explain::model {

/// One linear coefficient of a term: a size, or the sine or cosine part of one with a phase.
struct Coefficient {
  std::size_t parameter = 0;
  bool has_phase = false;
  int quadrature = 0;  ///< 1: the part a quarter of a turn ahead.
  double expected = 0, typical = 1;
  double largest = std::numeric_limits<double>::infinity();
  int sign = 0;
  int power = 1;  ///< The effect goes with this power of the size, and so do all of these.
};

}  // namespace fit::explain::model
