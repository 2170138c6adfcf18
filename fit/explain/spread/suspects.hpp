// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/odds.hpp"
#include "fit/explain/spread.hpp"
#include "fit/explain/spread/ids.hpp"
#include "fit/explain/stated_noise.hpp"

/// What all questions about the spread have in common: when a suspect is accepted, and what its size costs.
namespace fit::explain::spread {

// Log Bayes factors. Of 200 recordings with nothing missing three came to 2.9, and one, of six scans a
// capture, farther; of noise that 50 recordings held, at a signal of 6 to 40 times its noise, one had less
// than 4.
constexpr double accept_at = odds::against_any + odds::worth_a_noise;
constexpr double accept_rare_at = 5.5;  // ... where single samples decide, whose odds are less certain

/// Exponent of one over the intensity up to which a receiver's noise may grow: its variance goes with the
/// square of the echo's power, and counts with a root of that.
constexpr double steepest_of_noise = 5;

/// A mechanism of the catalogue, of which nothing is known yet.
[[nodiscard]] Suspect suspected(const char* id);
[[nodiscard]] bool is(const Suspect& suspect, const char* id);
[[nodiscard]] bool is_accepted(const SpreadResult& result, const char* id);
/// Accepted, or in a set.
[[nodiscard]] bool is_suspected(const SpreadResult& result, const char* id);
/// Noise of weak echoes that grows more steeply than a receiver's own does.
[[nodiscard]] bool is_steeper_than_a_receiver(const Suspect& suspect);
[[nodiscard]] bool holds_steep_noise(const std::vector<Suspect>& set);

/// Log of what one size costs that was found with that gain of the log-likelihood.
[[nodiscard]] double price_of_size(double gain);

/// What else the formula of noise may be wrong by explains: of its gain.
[[nodiscard]] double may_be_of_its_formula(const Suspect& noise);

/// Takes noise and memory away, and sets that hold them, that gain less than that.
void distrust_noise(double least_gain_of_noise, double least_gain_of_memory, SpreadResult& result);

/// A size from its square; each with its standard uncertainty.
[[nodiscard]] Estimate root(const Estimate& square);
/// The same, in degrees from rad^2.
[[nodiscard]] Estimate root_deg(const Estimate& square_rad2);

}  // namespace fit::explain::spread
