// SPDX-License-Identifier: MIT
#pragma once

#include <optional>

#include "fit/explain/reduce.hpp"

/// Where a recording was taken, and what looks alike from there.
namespace fit::explain {

/// Degrees from one stop of the stage to the next; none if it never stops, or at fewer than three places.
[[nodiscard]] std::optional<double> stops_apart_deg(const Reduced& reduced);

/// Whether stops so far apart show a period of the stage as something slow: then it is another name for a
/// scale or an eccentricity, by chance within a thousandth.
[[nodiscard]] bool looks_slow(double period_deg, double spacing_deg);

/// Millimetres from one place of a regular ladder of distances to the next.
[[nodiscard]] std::optional<double> rung_mm(const Reduced& reduced);

}  // namespace fit::explain
