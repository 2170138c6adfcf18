// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "fit/numeric/angle.hpp"

namespace fit::explain {

/// Columns all around, for beams whose angles differ from scan to scan. One of them has its middle where
/// beams lie in the first scan, so that those of others fall beside it by as little as can be.
class AngleGrid {
 public:
  /// spacing_rad: of the beams; the columns' own divides a turn evenly.
  AngleGrid(double through_rad, double spacing_rad)
      : count_(static_cast<std::size_t>(std::clamp(std::lround(2 * pi / std::abs(spacing_rad)), 1L, 20000L))),
        first_rad_(std::fmod(wrap_angle(through_rad) + 3 * pi, this->spacing_rad()) - pi) {}

  [[nodiscard]] std::size_t count() const { return count_; }
  [[nodiscard]] double spacing_rad() const { return 2 * pi / static_cast<double>(count_); }
  [[nodiscard]] double middle_rad(std::size_t column) const {
    return first_rad_ + static_cast<double>(column) * spacing_rad();
  }
  [[nodiscard]] std::size_t column_of(double angle_rad) const {
    const double from_first = std::fmod(wrap_angle(angle_rad) - first_rad_ + 2 * pi, 2 * pi);
    return static_cast<std::size_t>(std::lround(from_first / spacing_rad())) % count_;
  }

 private:
  std::size_t count_;
  double first_rad_;
};

}  // namespace fit::explain
