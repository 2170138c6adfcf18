// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <vector>

#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain::reduction {

/// Products of every beam's deviation in one scan with those in the scans before, by bands of lags.
class LagProducts {
 public:
  explicit LagProducts(std::size_t beams) : sums_{std::vector<double>(beams, 0.0)}, before_(beams, 0.0) {}

  /// `deviation` (mm) of every beam in the next scan; 0 where there is none. The group sums up the products.
  void add(const std::vector<double>& deviation, Group& group);

 private:
  std::vector<std::vector<double>> sums_;  ///< Of all deviations before scan 0, 1, ...
  std::vector<double> before_;
};

}  // namespace fit::explain::reduction
