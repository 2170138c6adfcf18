// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "fit/mechanism.hpp"

namespace fit::explain::model {

/// A coordinate as the rows of a channel sample it: half by value, half by rank, so that neither a crowd nor
/// a lonely place takes all the room.
class Scale {
 public:
  /// Of at least one value; `uneven`: of a coordinate whose values may crowd.
  Scale(std::vector<double> values, bool uneven) : uneven_(uneven), sorted_(std::move(values)) {
    std::ranges::sort(sorted_);
    const std::size_t step = std::max<std::size_t>(1, sorted_.size() / 400);
    for (std::size_t i = 0; i < sorted_.size(); i += step) knots_.push_back(sorted_[i]);
  }
  [[nodiscard]] double operator()(double v) const {
    const double low = sorted_.front(), high = sorted_.back();
    if (!(high > low)) return 0;
    const double by_value = 2 * (v - low) / (high - low) - 1;
    if (!uneven_) return std::clamp(by_value, -1.0, 1.0);
    const auto next = std::ranges::upper_bound(knots_, v);
    const double rank = static_cast<double>(next - knots_.begin()) / static_cast<double>(knots_.size());
    return std::clamp((by_value + 2 * rank - 1) / 2, -1.0, 1.0);
  }
  [[nodiscard]] const std::vector<double>& sorted() const { return sorted_; }

  /// Whether values of that coordinate may crowd.
  [[nodiscard]] static bool may_crowd(Coordinate coordinate) {
    return coordinate == Coordinate::intensity || coordinate == Coordinate::range;
  }

 private:
  bool uneven_;
  std::vector<double> sorted_, knots_;
};

}  // namespace fit::explain::model
