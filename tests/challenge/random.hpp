// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "sim/polar_random.hpp"

namespace challenge {

/// Random numbers that are the same with every standard library: the engine is specified, its distributions
/// are not, so they are made here.
class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed * 0x9E3779B97F4A7C15ULL + 0x632BE59BD9B4E019ULL) {}

  /// Uniform in [0, 1).
  double uniform() { return static_cast<double>(engine_() >> 11) * 0x1.0p-53; }
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  /// Uniform in the logarithm, for sizes that may differ by orders of magnitude.
  double log_uniform(double low, double high) { return low * std::exp(uniform() * std::log(high / low)); }
  int integer(int low, int high) { return low + static_cast<int>(uniform() * (high - low + 1)); }
  double sign() { return uniform() < 0.5 ? -1.0 : 1.0; }
  bool chance(double probability) { return uniform() < probability; }

  /// Standard normal.
  double normal() {
    return normals_.next([this] { return uniform(); });
  }

  template <typename T>
  const T& pick(const std::vector<T>& items) {
    return items[static_cast<std::size_t>(uniform() * static_cast<double>(items.size()))];
  }

 private:
  std::mt19937_64 engine_;
  sim::PolarNormals normals_;
};

}  // namespace challenge
