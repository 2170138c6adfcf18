// SPDX-License-Identifier: MIT
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "fit/bench/bench.hpp"
#include "fit/mechanism.hpp"

namespace fit {

/// Throws std::invalid_argument where the bench knows a mechanism that the catalogue does not have, or a
/// parameter by a wrong name: the right one would stay at its default, another bench than its file says.
void demand_catalogued(const Bench& bench);

/// A mechanism at work, with its values in the order of its parameters.
struct Active {
  std::shared_ptr<const Mechanism> mechanism;
  std::vector<double> values;
  int target = -1;                 ///< The only target it acts on; -1: all.
  std::vector<double> sigma = {};  ///< Standard uncertainties of `values`; empty: none known.
};

/// A mechanism as bench files know it. `target`: the only one that it acts on; empty: all.
[[nodiscard]] KnownMechanism as_known(const Mechanism& mechanism, std::map<std::string, Estimate> parameters,
                                      const std::string& target = {});
/// Adds it to what the bench knows; what corrects a statement, to that statement.
void add_known(Bench& bench, KnownMechanism known);

/// All that a bench knows to be at work: mechanisms of the catalogue and, as such without parameters,
/// functions without a name. None that are of a target which it does not have.
[[nodiscard]] std::vector<Active> known_to_be_at_work(const Bench& bench);

}  // namespace fit
