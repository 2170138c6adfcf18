// SPDX-License-Identifier: MIT
#pragma once

#include <limits>

namespace fit {

/// A quantity with its standard uncertainty (GUM, k = 1), in whatever unit its name says.
/// A plain number converts to an estimate that is known exactly (u = 0).
struct Estimate {
  double value = std::numeric_limits<double>::quiet_NaN();
  double u = 0;

  constexpr Estimate() = default;
  constexpr Estimate(double value_, double u_ = 0) : value(value_), u(u_) {}  // NOLINT: implicit on purpose
  friend constexpr bool operator==(const Estimate&, const Estimate&) = default;
};

}  // namespace fit
