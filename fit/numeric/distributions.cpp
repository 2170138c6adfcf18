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

}  // namespace fit
