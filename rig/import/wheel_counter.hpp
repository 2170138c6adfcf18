// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <cstdint>
#include <optional>

#include "fit/numeric/angle.hpp"

namespace rig {

/// Turns an encoder's counts into the angle that its wheel has turned since the first: counts that grow, also
/// over the end of a counter of 16 bits, or counts since the row before.
class WheelCounter {
 public:
  WheelCounter(double counts_a_turn, bool increments) : a_turn_(counts_a_turn), increments_(increments) {}

  /// Radians.
  double angle(double count) {
    if (increments_) {
      sum_ += count;
    } else if (!last_) {
      sum_ = count;
    } else {
      double step = count - *last_;
      constexpr double range = 65536;
      const bool narrow = std::abs(count) < range && std::abs(*last_) < range && a_turn_ > 10;
      if (narrow && std::abs(step) > 0.75 * range && std::abs(step) <= range) {
        step -= std::copysign(range, step);
        ++overflows_;
      }
      sum_ += step;
    }
    last_ = count;
    return 2 * fit::pi * sum_ / a_turn_;
  }
  [[nodiscard]] std::uint64_t overflows() const { return overflows_; }

 private:
  double a_turn_, sum_ = 0;
  bool increments_;
  std::optional<double> last_;
  std::uint64_t overflows_ = 0;
};

}  // namespace rig
