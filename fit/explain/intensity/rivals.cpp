// SPDX-License-Identifier: MIT
#include "fit/explain/intensity/rivals.hpp"

#include <algorithm>

#include "fit/explain/intensity/deviations.hpp"
#include "fit/explain/intensity/unnamed.hpp"

namespace fit::explain::intensity {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double never_predicted_better = 0.01;

Suspicion suspicion_of(const LightSuspect& light) {
  Suspicion s;
  s.mechanism = light.mechanism;
  s.target = light.target;
  s.values = light.values;
  s.coefficients = light.coefficients;
  s.size = 1;
  return s;
}

VectorXd effect_of(const Readings& readings, const LightSuspect& light) {
  // A law of which the bench states nothing can be wrong in nothing.
  if (light.values.empty()) return VectorXd::Zero(readings.count());
  if (light.coefficients.empty()) return effect_of(readings, suspicion_of(light));
  const MatrixXd columns = law_columns(readings, readings.claim.law);
  VectorXd sum = VectorXd::Zero(readings.count());
  for (std::size_t k = 0; k < light.coefficients.size() && k < light.values.size(); ++k)
    sum += light.values[k] * columns.col(light.coefficients[k]);
  return sum;
}

/// What a rival can take up of anything: nuisances, and itself in whatever size.
Block base_of_rival(const Readings& readings, const Suspicion& rival) {
  Block base = nuisances(readings, {rival}, readings.claim.law);
  if (rival.acts() && !rival.values.empty()) {
    base.add(effect_of(readings, rival), 10);
    base.add(freedom_of(readings, rival));
  }
  return base;
}

}  // namespace

LightSuspect light_suspect(const Readings& readings, const std::vector<Suspicion>& accepted,
                           const Suspicion& s) {
  if (s.mechanism) return {s.mechanism, s.target, s.values, s.coefficients};
  LightSuspect law{find_mechanism(law_of_intensity), -1, {}, stated_coefficients(readings.claim)};
  const MatrixXd all = law_columns(readings, readings.claim.law);
  MatrixXd own(readings.count(), static_cast<Index>(law.coefficients.size()));
  for (std::size_t k = 0; k < law.coefficients.size(); ++k)
    own.col(static_cast<Index>(k)) = all.col(law.coefficients[k]);
  MatrixXd normal = own.transpose() * own;
  normal.diagonal().array() += 1e-3;
  const VectorXd x = normal.ldlt().solve(own.transpose() * function_of(readings, accepted, s));
  law.values.assign(x.data(), x.data() + x.size());
  return law;
}

MatrixXd evidence_between(const Readings& readings, const std::vector<LightSuspect>& suspects) {
  const auto size = static_cast<Index>(suspects.size());
  MatrixXd evidence = MatrixXd::Zero(size, size);
  VectorXd weight(readings.count());
  for (Index i = 0; i < readings.count(); ++i)
    weight[i] = 1 / std::max(never_predicted_better, readings.row(i).sigma);
  for (Index rival = 0; rival < size; ++rival) {
    const Block base = base_of_rival(readings, suspicion_of(suspects[static_cast<std::size_t>(rival)]));
    for (Index truth = 0; truth < size; ++truth) {
      if (truth == rival) continue;
      const VectorXd effect = effect_of(readings, suspects[static_cast<std::size_t>(truth)]);
      evidence(truth, rival) = 0.5 * Model(effect, weight, base).left_of(effect).squaredNorm();
    }
  }
  return evidence;
}

}  // namespace fit::explain::intensity
