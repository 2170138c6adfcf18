// SPDX-License-Identifier: MIT
#pragma once

#include <string>

namespace fit {

/// An uncertainty with two significant digits (GUM 7.2.6): 0.123 -> "0.12", 0 -> "0"; a small one
/// with a power of ten: 5.6e-7 -> "5.6e-7".
[[nodiscard]] std::string format_uncertainty(double expanded);

/// A value rounded to the place of its uncertainty's second digit: (-1.6342, 0.123) -> "-1.63" (with a
/// hyphen-minus), (1e-9, 5.6e-7) -> "0". Without an uncertainty, a whole number as it is, another with four
/// significant digits. Non-finite: "not determined".
[[nodiscard]] std::string format_value(double value, double expanded);

/// Both with the unit: (-1.6342, 0.123, "mm") -> "-1.63 ± 0.12 mm"; without an uncertainty the value alone.
[[nodiscard]] std::string format_measurement(double value, double expanded, const std::string& unit);

/// So many decimals, without the sign of what was rounded away: (-0.001, 2) -> "0.00".
[[nodiscard]] std::string format_fixed(double value, int decimals);

/// A sentence with up to three numbers, by a pattern of printf's: at most 399 characters.
[[nodiscard]] std::string formatted(const char* pattern, double a, double b = 0, double c = 0);

/// A number with its unit, if it has one.
[[nodiscard]] std::string with_unit(const std::string& number, const std::string& unit);

/// All digits of a value: the shortest text that reads back exactly, 0.1 as "0.1".
[[nodiscard]] std::string format_exactly(double value);

/// Coverage factor for 95.45 % at `degrees_of_freedom` (GUM G.2); 2 when they are infinite, unknown or large.
[[nodiscard]] double coverage_factor(double degrees_of_freedom);

}  // namespace fit
