// SPDX-License-Identifier: MIT
#include "fit/explain/odds.hpp"

#include <algorithm>
#include <cmath>

namespace fit::explain::odds {
namespace {

using Role = Parameter::Role;

/// Worms make periods of a few degrees, a wheel or scale off its axis one or two periods in a turn; what lies
/// between is nothing that a stage has, but at a few stage angles it can imitate everything.
double price_of_gear(double period_deg) {
  constexpr double fewest_teeth_deg = 7.5, odd = 3;
  return period_deg < fewest_teeth_deg || std::abs(period_deg - 360) < 1 || std::abs(period_deg - 180) < 1
             ? 0
             : odd;
}

}  // namespace

double against(const Term& term) {
  const auto gear = term.mechanism->parameter_of(Parameter::Scale::gear);
  double price = gear ? price_of_gear(term.values[*gear]) : 0;
  for (std::size_t k = 0; k < term.values.size(); ++k) {
    const Parameter& p = term.mechanism->parameters[k];
    // At the end of what physics allows: the recording would rather have something else.
    if (p.scale == Parameter::Scale::decay &&
        (term.values[k] > 0.98 * p.upper || term.values[k] < 1.02 * p.lower))
      price += 4;
    if (p.role != Role::size) continue;
    const double ratio = std::abs(term.values[k] - p.expected) / p.typical;
    if (ratio > 10) price += 0.5 * std::pow((ratio - 10) / 3, 2);
    const double u = term.sigma.empty() ? 0 : std::max(1e-12, term.sigma[k]);
    if (std::abs(term.values[k]) > p.largest)
      price += u > 0 ? 0.5 * std::pow((std::abs(term.values[k]) - p.largest) / u, 2) : 50;
    if (p.sign != 0 && !has_phase(*term.mechanism, k) && term.values[k] * p.sign < 0)
      price += u > 0 ? 0.7 + 0.5 * std::pow(term.values[k] / u, 2) : 50;
  }
  return price;
}

double against_place(double gain, double places) {
  return std::max(0.0, std::log(places)) + 0.5 * std::log(1 + std::max(0.0, gain) / 2);
}

}  // namespace fit::explain::odds
