// SPDX-License-Identifier: MIT
#include "fit/explain/spread/suspects.hpp"

#include <algorithm>
#include <cmath>

#include "fit/explain/spread/curves.hpp"

namespace fit::explain::spread {

Suspect suspected(const char* id) {
  Suspect suspect;
  suspect.mechanism = find_mechanism(id);
  return suspect;
}

bool is(const Suspect& suspect, const char* id) { return suspect.mechanism && suspect.mechanism->id == id; }

bool is_accepted(const SpreadResult& result, const char* id) {
  return std::ranges::any_of(result.accepted, [&](const Suspect& s) { return is(s, id); });
}

bool is_suspected(const SpreadResult& result, const char* id) {
  const auto holds_it = [&](const auto& set) {
    return std::ranges::any_of(set, [&](const Suspect& s) { return is(s, id); });
  };
  return holds_it(result.accepted) || std::ranges::any_of(result.undecided, holds_it);
}

bool is_steeper_than_a_receiver(const Suspect& suspect) {
  return is(suspect, ids::intensity_noise) && suspect.parameters.at("exponent").value > steepest_of_noise;
}

bool holds_steep_noise(const std::vector<Suspect>& set) {
  return std::ranges::any_of(set, is_steeper_than_a_receiver);
}

double may_be_of_its_formula(const Suspect& noise) {
  // The share of its effect by which a formula may be wrong. Of a real mirror whose angles are rounded to its
  // beams' spacing, an unnamed law of the incidence explains 4 % more than scattering angles do.
  constexpr double formula_error = 0.25;
  return formula_error * formula_error * noise.gain;
}

void distrust_noise(double least_gain_of_noise, double least_gain_of_memory, SpreadResult& result) {
  const auto is_small = [&](const Suspect& s) {
    if (!s.mechanism) return false;
    const Observable shows_in = s.mechanism->observable;
    return (shows_in == Observable::range_variance && s.gain < least_gain_of_noise) ||
           (shows_in == Observable::time_correlation && s.gain < least_gain_of_memory);
  };
  std::erase_if(result.accepted, is_small);
  std::erase_if(result.undecided, [&](const auto& set) { return std::ranges::any_of(set, is_small); });
  drop_curves_of_nothing(result);
}

double price_of_size(double gain) { return 0.5 * std::log(1 + 2 * std::max(0.0, gain)) + 0.7; }

Estimate root(const Estimate& square) {
  const double size = std::sqrt(std::max(0.0, square.value));
  return {size, size > 0 ? std::min(square.u / (2 * size), std::sqrt(square.u)) : std::sqrt(square.u)};
}

Estimate root_deg(const Estimate& square_rad2) {
  constexpr double degree2 = deg_per_rad * deg_per_rad;
  return root({square_rad2.value * degree2, square_rad2.u * degree2});
}

}  // namespace fit::explain::spread
