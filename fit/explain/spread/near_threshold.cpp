// SPDX-License-Identifier: MIT
#include <algorithm>
#include <iterator>

#include "fit/explain/spread/questions.hpp"
#include "fit/explain/spread/suspects.hpp"

namespace fit::explain::spread {
namespace {

/// Mean intensity of the cell that is darkest.
double weakest_echo(const Reduced& reduced) {
  double weakest = 1e9;
  for (const Cell& cell : reduced.cells)
    if (cell.smooth && cell.at.intensity > 0) weakest = std::min(weakest, cell.at.intensity);
  return weakest;
}

/// Of which nothing has been lost yet: somewhat below the weakest echo there is, how far nobody knows.
Suspect dropout_below(double weakest) {
  Suspect dropout = suspected(ids::dropout);
  dropout.parameters = {{"intensity_min", {0.75 * weakest, 0.15 * weakest}},
                        {"width", {0.03 * weakest, 0.03 * weakest}}};
  return dropout;
}

}  // namespace

void may_be_near_threshold(const Reduced& reduced, SpreadResult& result) {
  if (is_accepted(result, ids::dropout)) {
    // Echoes that are about to be lost scatter more: the same cause.
    const auto bring_along = [&](const std::vector<Suspect>& list) {
      std::ranges::copy_if(list, std::back_inserter(result.brought_along), is_steeper_than_a_receiver);
    };
    bring_along(result.accepted);
    std::erase_if(result.accepted, is_steeper_than_a_receiver);
    for (const auto& set : result.undecided) bring_along(set);
    std::erase_if(result.undecided, holds_steep_noise);
    return;
  }
  const Suspect dropout = dropout_below(weakest_echo(reduced));
  const auto noise = std::ranges::find_if(result.accepted, is_steeper_than_a_receiver);
  if (noise != result.accepted.end()) {
    result.undecided.push_back({*noise});
    result.accepted.erase(noise);
  }
  for (auto& set : result.undecided) {
    if (!holds_steep_noise(set)) continue;
    set.insert(set.begin() + 1, dropout);
    set[1].gain = set.front().gain;
    set[1].evidence = set.front().evidence;
  }
}

}  // namespace fit::explain::spread
