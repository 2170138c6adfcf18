// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/reduce.hpp"
#include "fit/explain/search/fitting.hpp"

namespace fit::explain::search {

constexpr std::size_t finalists = 7;

/// How a climb goes.
struct Way {
  std::size_t tries = finalists;  ///< Candidates fitted at every move.
  bool exchange = true;           ///< Whether what is there may be exchanged.
  bool unnamed = true;            ///< Whether unnamed functions may be added too.
};

/// Adds, drops and exchanges until nothing helps. `h` must be fitted.
[[nodiscard]] Hypothesis climbed(Fitting& fitting, Hypothesis h, const Way& way);

/// The best hypothesis that any way up from a start leads to, which may be far from its best values.
[[nodiscard]] Hypothesis explored(Fitting& fitting, Hypothesis empty, const Progress& progress);

/// Whether a term says of its coordinate no more than that the range follows it, by whatever curve: then a
/// curve of that coordinate is no other explanation. A step, a bump or a wave is.
[[nodiscard]] bool says_any_curve_of(const Term& term, const Shape& shape);

/// How far names may be behind unnamed functions: less far behind a step or a wave, which hardly resemble
/// anything else. A mechanism of which only the coordinate is certain may be farther behind another curve
/// of that, but no step behind a step: its own curve has taken up what it could.
[[nodiscard]] double preference(const Hypothesis& named, const Hypothesis& unnamed);

/// Tells how far the search is, 0..1.
void report(const Progress& progress, double share);

}  // namespace fit::explain::search
