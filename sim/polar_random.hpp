// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>

#include "sim/random.hpp"

namespace sim {

/// Standard normals in pairs from any numbers uniform in [0, 1), by Marsaglia's polar method.
class PolarNormals {
 public:
  template <typename Uniform>
  double next(Uniform&& uniform) {
    if (has_spare_) {
      has_spare_ = false;
      return spare_;
    }
    double u, v, s;
    do {
      u = 2 * uniform() - 1;
      v = 2 * uniform() - 1;
      s = u * u + v * v;
    } while (s >= 1 || s == 0);
    const double scale = std::sqrt(-2 * std::log(s) / s);
    spare_ = v * scale;
    has_spare_ = true;
    return u * scale;
  }

 private:
  double spare_ = 0;
  bool has_spare_ = false;
};

/// What the causal and the model engine draw from, so that a seed goes on making the recordings that it made.
class PolarRandom : public Xoshiro256 {
 public:
  using Xoshiro256::Xoshiro256;

  /// Standard normal.
  double normal() {
    return normals_.next([this] { return uniform(); });
  }

 private:
  PolarNormals normals_;
};

}  // namespace sim
