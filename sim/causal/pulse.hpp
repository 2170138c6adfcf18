// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

namespace sim::causal {

inline constexpr double light_mm_per_ns = 299.792458 / 2;  ///< Range per nanosecond of echo delay.

/// One echo's shape in time, peak 1 at 0 (before a tail delays and lowers it), tabulated.
class Pulse {
 public:
  /// `shape` as in the world file; `tail_ns`: mean delay of light that comes back from inside a translucent
  /// target (the echo convolved with an exponential of unit area: light diffusing in a turbid body).
  Pulse(const std::string& shape, double rise_ns, double tail_ns = 0);

  [[nodiscard]] double begins_ns() const { return begin_; }
  [[nodiscard]] double ends_ns() const { return end_; }
  [[nodiscard]] double rise_ns() const { return rise_; }
  [[nodiscard]] double operator()(double t) const {
    const double x = (t - begin_) * scale_;
    if (x < 0 || x >= last_) return 0;
    const auto i = static_cast<std::size_t>(x);
    const double f = x - static_cast<double>(i);
    return table_[i] + f * (table_[i + 1] - table_[i]);
  }

 private:
  double begin_ = 0, end_ = 0, scale_ = 1, last_ = 0, rise_ = 1;
  std::vector<double> table_;
};

}  // namespace sim::causal
