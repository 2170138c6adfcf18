// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace rig {

/// A rule by which a control chart says that a process is not what it was, and where it holds.
struct ChartSignal {
  std::string rule;                 ///< Its name and words.
  std::vector<std::size_t> points;  ///< The points that make it hold.
};

/// The rules 1 to 4 of Western Electric (Statistical Quality Control Handbook, 1956) and rule 3 of Nelson (J.
/// Quality Technology 16, 1984) on the values of a chart in order, as distances from the centre line in
/// standard deviations.
[[nodiscard]] std::vector<ChartSignal> chart_signals(std::span<const double> distances);

/// How well a quantity repeats from one calibration to the next, from the differences between successive
/// ones: their median size over 0.954, which a few devices that drift or jump do not widen.
struct Repeatability {
  double sigma = 0;
  std::size_t differences = 0;
  /// Effective degrees of freedom of sigma: 0.37 a difference, by the spread of a median of half-normal
  /// values.
  [[nodiscard]] double degrees_of_freedom() const { return 0.37 * static_cast<double>(differences); }
};
[[nodiscard]] Repeatability repeatability_of(std::vector<double> differences);

/// The error of one calibration against another (ISO/IEC 17043, B.3): the difference over the root sum of
/// squares of both expanded uncertainties; at most 1 agrees. NaN without uncertainties.
[[nodiscard]] double e_n(double value, double expanded, double before, double expanded_before);

/// A straight line through values over time, by least squares.
struct Drift {
  double at_zero = 0, per_year = 0;  ///< The line at time 0 and its slope.
  double u = 0;                      ///< Standard uncertainty of the slope.
  double degrees_of_freedom = 0;
  double expanded = 0;  ///< At 95.45 %.
  double p_value = 1;   ///< Of so large a slope by chance, two-sided.
  double residual = 0;  ///< Root mean square of the values about the line, by degrees of freedom.
};

/// `sigma` of a value with its degrees of freedom is pooled with the scatter of the values about the line,
/// unless that is far larger (F test at 1 %) or sigma is 0: then only the values tell. Fewer than three
/// values, or all at one time, have no line: `degrees_of_freedom` is 0 then.
[[nodiscard]] Drift drift_of(std::span<const double> years, std::span<const double> values, double sigma,
                             double degrees_of_freedom);

/// After how many years a value that moves by `per_year` (with its expanded uncertainty) has moved by `up` or
/// down by `down`; infinite if never.
[[nodiscard]] double years_until(double up, double down, double per_year, double expanded);

/// Which of several findings hold when all are looked at: Benjamini and Hochberg (1995) at a rate of false
/// ones.
[[nodiscard]] std::vector<bool> found_at_rate(std::span<const double> p_values, double rate);

}  // namespace rig
