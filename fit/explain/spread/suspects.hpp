// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/odds.hpp"
#include "fit/explain/spread.hpp"
#include "fit/explain/spread/ids.hpp"

/// What the questions about single samples have in common: when a suspect is accepted, and what its size
/// costs.
namespace fit::explain::spread {

constexpr double accept_rare_at = 5.5;  // log Bayes factor, where single samples decide

/// A mechanism of the catalogue, of which nothing is known yet.
[[nodiscard]] Suspect suspected(const char* id);

/// Log of what one size costs that was found with that gain of the log-likelihood.
[[nodiscard]] double price_of_size(double gain);

}  // namespace fit::explain::spread
