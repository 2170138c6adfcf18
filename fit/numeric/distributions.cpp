// SPDX-License-Identifier: MIT
#include "fit/numeric/distributions.hpp"

#include <algorithm>
#include <boost/math/distributions/binomial.hpp>
#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/fisher_f.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <limits>

namespace fit {

double chi_squared_cdf(double freedom, double x) { return cdf(boost::math::chi_squared(freedom), x); }

double chi_squared_quantile(double freedom, double probability) {
  return quantile(boost::math::chi_squared(freedom), probability);
}

double student_quantile(double freedom, double probability) {
  return quantile(boost::math::students_t(freedom), probability);
}

double normal_quantile(double probability) { return quantile(boost::math::normal(), probability); }

double normal_equivalent(double freedom, double t) {
  const double above = cdf(complement(boost::math::students_t(freedom), std::abs(t)));
  const double z =
      quantile(complement(boost::math::normal(), std::max(above, std::numeric_limits<double>::min())));
  return std::copysign(z, t);
}

double fisher_above(double numerator_freedom, double denominator_freedom, double x) {
  return cdf(complement(boost::math::fisher_f(numerator_freedom, denominator_freedom), x));
}

double binomial_at_least(double n, double probability, double count) {
  return cdf(complement(boost::math::binomial(n, probability), count - 1));
}

double beta_binomial_at_least(double n, double a, double b, double count) {
  if (count <= 0) return 1;
  if (count > n) return 0;
  const auto log_beta = [](double x, double y) {
    return std::lgamma(x) + std::lgamma(y) - std::lgamma(x + y);
  };
  const auto at = [&](double k) {
    return std::exp(-std::log(n + 1) - log_beta(n - k + 1, k + 1) + log_beta(k + a, n - k + b) -
                    log_beta(a, b));
  };
  // The tail beyond the mean, whose terms fall.
  const bool is_above = count > n * a / (a + b);
  double sum = 0;
  if (is_above)
    for (double k = count, term = at(k); k <= n && term > 1e-12 * sum; ++k) {
      sum += term;
      term *= (n - k) * (k + a) / ((k + 1) * (n - k - 1 + b));
    }
  else
    for (double k = count - 1, term = at(k); k >= 0 && term > 1e-12 * sum; --k) {
      sum += term;
      term *= k * (n - k + b) / ((n - k + 1) * (k - 1 + a));
    }
  return std::clamp(is_above ? sum : 1 - sum, 0.0, 1.0);
}

}  // namespace fit
