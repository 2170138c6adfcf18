// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cmath>
#include <cstdint>

namespace sim {

/// Seeded random bits that are the same with every standard library: xoshiro256++ (Blackman and Vigna 2019).
class Xoshiro256 {
 public:
  explicit Xoshiro256(std::uint64_t seed) {
    for (auto& word : state_) {  // splitmix64 spreads any seed over the whole state
      seed += 0x9e3779b97f4a7c15;
      std::uint64_t z = seed;
      z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
      z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
      word = z ^ (z >> 31);
    }
  }

  std::uint64_t bits() {
    const std::uint64_t result = rotl(state_[0] + state_[3], 23) + state_[0];
    const std::uint64_t t = state_[1] << 17;
    state_[2] ^= state_[0];
    state_[3] ^= state_[1];
    state_[1] ^= state_[2];
    state_[0] ^= state_[3];
    state_[2] ^= t;
    state_[3] = rotl(state_[3], 45);
    return result;
  }

  /// Uniform in [0, 1).
  double uniform() { return static_cast<double>(bits() >> 11) * 0x1.0p-53; }

 private:
  static std::uint64_t rotl(std::uint64_t value, int by) { return value << by | value >> (64 - by); }
  std::array<std::uint64_t, 4> state_{};
};

/// With normals by the ziggurat (Marsaglia and Tsang 2000, with Doornik's 2005 separate bits for layer and
/// value).
class Random : public Xoshiro256 {
 public:
  using Xoshiro256::Xoshiro256;

  /// Standard normal.
  double normal() {
    const Ziggurat& layers = ziggurat();
    while (true) {
      const std::uint64_t word = bits();
      const auto layer = static_cast<std::size_t>(word & 0x7f);
      const double u = static_cast<double>(static_cast<std::int64_t>(word) >> 11) * 0x1.0p-52;
      const double x = u * layers.x[layer];
      if (std::abs(x) < layers.x[layer + 1]) return x;
      if (layer == 0) return tail(u < 0);
      const double y = layers.y[layer] + uniform() * (layers.y[layer + 1] - layers.y[layer]);
      if (y < std::exp(-0.5 * x * x)) return x;
    }
  }

 private:
  static constexpr int layer_count = 128;
  static constexpr double tail_start = 3.442619855899;

  struct Ziggurat {
    std::array<double, layer_count + 1> x{}, y{};
    Ziggurat() {
      constexpr double area = 9.91256303526217e-3;
      const auto f = [](double v) { return std::exp(-0.5 * v * v); };
      x[0] = area / f(tail_start);
      x[1] = tail_start;
      for (std::size_t i = 2; i < layer_count; ++i)
        x[i] = std::sqrt(-2 * std::log(area / x[i - 1] + f(x[i - 1])));
      x[layer_count] = 0;
      for (std::size_t i = 0; i <= layer_count; ++i) y[i] = f(x[i]);
    }
  };
  static const Ziggurat& ziggurat() {
    static const Ziggurat layers;
    return layers;
  }

  double tail(bool negative) {
    double x = 0, y = 0;
    do {
      x = std::log(1 - uniform()) / tail_start;
      y = std::log(1 - uniform());
    } while (-2 * y < x * x);
    return negative ? x - tail_start : tail_start - x;
  }
};

}  // namespace sim
