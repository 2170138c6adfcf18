// SPDX-License-Identifier: MIT
#include "fit/explain/model/gaussian.hpp"

#include <algorithm>
#include <cmath>

#include "fit/explain/numbers.hpp"

namespace fit::explain::inference {

using Eigen::Index;

namespace {

/// Log of the normal distribution's integral up to z.
double log_normal_integral(double z) {
  if (z > -20) return std::log(std::max(1e-300, 0.5 * std::erfc(-z / std::sqrt(2.0))));
  return -0.5 * z * z - std::log(-z * std::sqrt(2 * pi));
}

}  // namespace

double log_sum(const std::vector<double>& logs) {
  if (logs.empty()) return -1e300;
  const double most = *std::ranges::max_element(logs);
  double sum = 0;
  for (const double one : logs) sum += std::exp(one - most);
  return most + std::log(sum);
}

double log_determinant(const Eigen::LLT<Eigen::MatrixXd>& factor) {
  return 2 * factor.matrixLLT().diagonal().array().log().sum();
}

Integral integrate(const Quadratic& likelihood, const Prior& prior) {
  const Index k = likelihood.along.size();
  Integral result;
  const auto& s = prior.sigma;
  Eigen::MatrixXd normal = s.asDiagonal() * likelihood.square * s.asDiagonal();
  normal.diagonal().array() += 1;
  const Eigen::LLT<Eigen::MatrixXd> factor(normal);
  const Eigen::VectorXd rhs = s.cwiseProduct(likelihood.along - likelihood.square * prior.mean),
                        x = factor.solve(rhs);
  result.log_evidence = prior.mean.dot(likelihood.along) -
                        0.5 * prior.mean.dot(likelihood.square * prior.mean) + 0.5 * rhs.dot(x) -
                        0.5 * log_determinant(factor);
  result.value = prior.mean + s.cwiseProduct(x);
  result.covariance = s.asDiagonal() * factor.solve(Eigen::MatrixXd::Identity(k, k)) * s.asDiagonal();
  return result;
}

std::vector<Factor> factors_of(const model::Kind& kind) {
  const bool is_expected =
      std::ranges::any_of(kind.coefficients, [](const auto& c) { return c.expected != 0; });
  if (is_expected || kind.coefficients.empty()) return {{1, 0}};
  std::vector<Factor> list;
  double sum = 0;
  for (double z = -4.5; z < 4; z += 1) {
    const double log_density = -1.5 * std::log1p(z * z / 2);  // Student's t of two degrees of freedom
    list.push_back({std::exp(z * numbers::size_factor_log), log_density});
    sum += std::exp(log_density);
  }
  for (Factor& f : list) f.log_weight -= std::log(sum);
  return list;
}

Prior prior_of(const model::Kind& kind, double factor) {
  const auto k = static_cast<Index>(kind.coefficients.size());
  Prior prior{Eigen::VectorXd(k), Eigen::VectorXd(k)};
  for (Index i = 0; i < k; ++i) {
    const model::Coefficient& c = kind.coefficients[static_cast<std::size_t>(i)];
    prior.mean[i] = c.expected;
    prior.sigma[i] = c.typical * std::pow(factor, c.power);
  }
  return prior;
}

double log_possible(const model::Kind& kind, const Eigen::VectorXd& value,
                    const Eigen::MatrixXd& covariance) {
  double sum = 0;
  for (std::size_t k = 0; k < kind.coefficients.size(); ++k) {
    const model::Coefficient& c = kind.coefficients[k];
    const auto i = static_cast<Index>(k);
    const double u = std::sqrt(std::max(1e-300, covariance(i, i)));
    if (c.sign != 0) sum += std::log(2.0) + log_normal_integral(c.sign * value[i] / u);
    if (std::isfinite(c.largest)) sum += log_normal_integral((c.largest - std::abs(value[i])) / u);
  }
  return sum;
}

OverFactors integrate_over_factors(const Quadratic& likelihood, const model::Kind& kind,
                                   const FactorRange& range) {
  const Index k = likelihood.along.size();
  OverFactors result;
  std::vector<double> logs;
  double most = -1e300;
  for (const Factor& f : factors_of(kind)) {
    if (f.factor < range.least || (f.factor > range.most && !logs.empty())) continue;
    Prior prior = prior_of(kind, f.factor);
    prior.append(Prior::around_zero(k - prior.mean.size()));
    Integral one = integrate(likelihood, prior);
    one.log_evidence = std::min(one.log_evidence, range.highest) + f.log_weight +
                       log_possible(kind, one.value, one.covariance);
    logs.push_back(one.log_evidence);
    if (one.log_evidence <= most) continue;
    most = one.log_evidence;
    result.best = std::move(one);
    result.factor = f.factor;
  }
  result.log_evidence = log_sum(logs);
  return result;
}

}  // namespace fit::explain::inference
