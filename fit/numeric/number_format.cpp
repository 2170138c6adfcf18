// SPDX-License-Identifier: MIT
#include "fit/numeric/number_format.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>

#include "fit/numeric/distributions.hpp"

namespace fit {
namespace {

/// Decimals that leave two significant digits of `u`, after rounding (0.0996 -> 0.10).
int decimals_for(double u) {
  const int exponent = static_cast<int>(std::floor(std::log10(u)));
  const int decimals = 1 - exponent;
  const double rounded = std::round(u * std::pow(10.0, decimals)) / std::pow(10.0, decimals);
  return std::floor(std::log10(rounded)) > exponent ? decimals - 1 : decimals;
}

/// More are not counted but written with a power of ten.
constexpr int most_decimals = 5;

/// "5.6e-7": `digits` significant ones, and no zeros before the exponent.
std::string with_power_of_ten(double value, int digits) {
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%.*e", std::max(digits, 1) - 1, value);
  std::string out = text.data();
  const std::size_t exponent = out.find('e') + 2;
  out.erase(exponent, std::min(out.find_first_not_of('0', exponent), out.size() - 1) - exponent);
  return out;
}

/// A value to so many decimals that a small one is better read with a power of ten.
std::string to_many_decimals(double value, int decimals) {
  const double place = std::pow(10.0, -decimals), rounded = std::round(value / place) * place;
  if (rounded == 0) return "0";
  const int exponent = static_cast<int>(std::floor(std::log10(std::abs(rounded) * (1 + 1e-12))));
  return exponent < -4 ? with_power_of_ten(rounded, exponent + decimals + 1) : format_fixed(value, decimals);
}

}  // namespace

std::string format_fixed(double value, int decimals) {
  std::array<char, 400> text{};
  if (decimals < 0) {
    const double unit = std::pow(10.0, -decimals);
    value = std::round(value / unit) * unit;
    decimals = 0;
  }
  std::snprintf(text.data(), text.size(), "%.*f", decimals, value);
  std::string out = text.data();
  if (out[0] == '-' && out.find_first_not_of("-0.") == std::string::npos) out.erase(0, 1);  // no "-0.00"
  return out;
}

std::string formatted(const char* pattern, double a, double b, double c) {
  std::array<char, 400> out{};
  std::snprintf(out.data(), out.size(), pattern, a, b, c);
  return out.data();
}

std::string with_unit(const std::string& number, const std::string& unit) {
  return unit.empty() ? number : number + " " + unit;
}

std::string format_uncertainty(double expanded) {
  if (!std::isfinite(expanded)) return "not determined";
  if (expanded <= 0) return "0";
  const int decimals = decimals_for(expanded);
  return decimals > most_decimals ? with_power_of_ten(expanded, 2) : format_fixed(expanded, decimals);
}

std::string format_value(double value, double expanded) {
  if (!std::isfinite(value)) return "not determined";
  if (std::isfinite(expanded) && expanded > 0) {
    const int decimals = decimals_for(expanded);
    return decimals > most_decimals ? to_many_decimals(value, decimals) : format_fixed(value, decimals);
  }
  if (value == 0) return "0";  // no "-0"
  std::array<char, 64> text{};
  const bool whole = std::abs(value) < 1e9 && (std::floor(value) == value || std::abs(value) >= 1000);
  std::snprintf(text.data(), text.size(), whole ? "%.0f" : "%.4g", value);
  return text.data();
}

std::string format_measurement(double value, double expanded, const std::string& unit) {
  return with_unit(format_value(value, expanded) + (expanded > 0 ? " ± " + format_uncertainty(expanded) : ""),
                   unit);
}

std::string format_exactly(double value) {
  std::array<char, 32> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value).ptr;
  return std::string(text.data(), end);
}

double coverage_factor(double degrees_of_freedom) {
  if (!std::isfinite(degrees_of_freedom) || degrees_of_freedom > 200 || degrees_of_freedom <= 0) return 2;
  return student_quantile(std::max(1.0, degrees_of_freedom), 0.5 + 0.9545 / 2);
}

}  // namespace fit
