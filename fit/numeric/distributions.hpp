// SPDX-License-Identifier: MIT
/// Probability distributions by Boost.Math, compiled once: its headers cost the compiler 2 to 3 s a file.
#pragma once

namespace fit {

/// P(X <= x) of chi-squared with `freedom` degrees of freedom.
double chi_squared_cdf(double freedom, double x);
/// The x with P(X <= x) = `probability`.
double chi_squared_quantile(double freedom, double probability);
/// The t with P(T <= t) = `probability`, Student's distribution.
double student_quantile(double freedom, double probability);
/// The x with P(X <= x) = `probability`, standard normal distribution.
double normal_quantile(double probability);
/// The standard normal deviate that is as improbable as `t` is by Student's distribution.
double normal_equivalent(double freedom, double t);
/// P(F > x), Fisher's distribution.
double fisher_above(double numerator_freedom, double denominator_freedom, double x);
/// P(at least `count` of `n`), each by itself with `probability`.
double binomial_at_least(double n, double probability, double count);
/// P(at least `count` of `n`), all with one probability of which Beta(`a`, `b`) is known.
double beta_binomial_at_least(double n, double a, double b, double count);

}  // namespace fit
