// SPDX-License-Identifier: MIT
#include "fit/explain/intensity/suspicion.hpp"

#include <algorithm>
#include <cmath>

#include "fit/explain/intensity/bells.hpp"

namespace fit::explain::intensity {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

double effect_at(const Readings& readings, const Suspicion& s, Index i) {
  const Circumstances& at = readings.cell(i).at;
  if (s.target >= 0 && s.target != at.target) return 0;
  return s.mechanism->act(at, s.values).log_intensity;
}

Suspicion moved(Suspicion s, std::size_t k, double by) {
  const Parameter& p = s.mechanism->parameters[k];
  if (by_logarithm(p))
    s.values[k] = std::clamp(s.values[k] * std::exp(by), p.lower / 1.5, p.upper * 1.5);
  else
    s.values[k] += by;
  return s;
}

}  // namespace

std::vector<const Mechanism*> beside_the_law() {
  std::vector<const Mechanism*> list;
  for (const Mechanism& m : catalogue())
    if (m.observable == Observable::intensity && m.id != law_of_intensity) list.push_back(&m);
  return list;
}

bool is_of_surfaces(const Mechanism& mechanism) { return mechanism.coordinate == Coordinate::incidence; }

bool Suspicion::same_as(const Suspicion& o) const {
  if (mechanism != o.mechanism) return false;
  if (patch && o.patch)
    return about == o.about && patch->from_mm < o.patch->to_mm && o.patch->from_mm < patch->to_mm;
  if (!mechanism) return coordinate == o.coordinate && about == o.about && !patch == !o.patch;
  return true;
}

std::vector<Suspicion> without(std::vector<Suspicion> list, std::size_t index) {
  list.erase(list.begin() + static_cast<std::ptrdiff_t>(index));
  return list;
}

VectorXd effect_of(const Readings& readings, const Suspicion& s) {
  VectorXd effect(readings.count());
  for (Index i = 0; i < readings.count(); ++i) effect[i] = effect_at(readings, s, i);
  return effect;
}

bool by_logarithm(const Parameter& p) { return p.role == Parameter::Role::shape && p.logarithmic; }

std::vector<Searched> searched(const Mechanism& mechanism) {
  std::vector<Searched> list;
  for (std::size_t k = 0; k < mechanism.parameters.size(); ++k) {
    const Parameter& p = mechanism.parameters[k];
    if (p.role == Parameter::Role::size)
      list.push_back({k, p.typical});
    else if (by_logarithm(p))
      list.push_back({k, std::log(p.upper / p.lower) / std::sqrt(12.0)});
    else
      list.push_back({k, (p.upper - p.lower) / std::sqrt(12.0)});
  }
  return list;
}

VectorXd slope_of(const Readings& readings, const Suspicion& s, const Searched& by) {
  const double h = 0.02 * by.sigma;
  return (effect_of(readings, moved(s, by.parameter, h)) - effect_of(readings, moved(s, by.parameter, -h))) /
         (2 * h);
}

VectorXd places_of(const Readings& readings, const Suspicion& s) {
  if (s.about < 0) return readings.coordinate(s.coordinate);
  VectorXd x(readings.count());
  for (Index i = 0; i < readings.count(); ++i) {
    const Circumstances& at = readings.cell(i).at;
    x[i] = at.target == s.about ? at.along_mm : std::nan("");
  }
  return x;
}

MatrixXd columns_of(const Readings& readings, const Suspicion& s) {
  VectorXd x = places_of(readings, s);
  if (s.patch) {
    const auto inside = [&](double v) { return v >= s.patch->from_mm && v < s.patch->to_mm ? 1.0 : 0.0; };
    return x.unaryExpr(inside);
  }
  if (s.other_law()) x = x.array().log();
  return bells(x, s.length * span_of(x));
}

}  // namespace fit::explain::intensity
