// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/columns.hpp"

/// What is believed before the recording is looked at, in logarithms of odds.
namespace fit::explain::odds {

constexpr double price_of_mechanism = 4.0;  // log odds against any one of the catalogue
constexpr double price_of_unknown = 7.0;    // the catalogue is tried first
// Whoever asks suspects something. Of 92 recordings with nothing missing, one (whose wall stood 4.4 standard
// uncertainties off) was worth a name; none of the others came nearer than 0.9, or than 1.3 to an unnamed
// form.
constexpr double something_is_missing = 1.8;
/// Against one mechanism of the catalogue, asked for by itself.
constexpr double against_any = price_of_mechanism - something_is_missing;
constexpr double worth_a_name = 3;                 // a name that explains as much is preferred
constexpr double worth_a_name_beside_a_place = 2;  // ... of a step, or a period
/// How much less a name is trusted than preferred. Of 140 sessions of one cause, of the catalogue or not,
/// names less than 5 ahead of an unnamed form were right in 8 of 14, and all others in 83 of 83.
constexpr double more_than_forms_show = 2.8;
constexpr double close_behind = 3.5;   // within this suspects are not told apart
constexpr double strained = 4.5;       // log of the odds at which stated uncertainties are not believed
constexpr double worth_a_noise = 1.3;  // variances and correlations are asked more questions than means
constexpr double worth_a_first_name = 0.5, worth_a_first_form = -1, worth_a_move = 1.5, worth_fitting = -2;

/// How far out of the ordinary a size is: catalogues' orders of magnitude may be wrong, but not by anything.
[[nodiscard]] double against(const Term& term);
/// Against one searched parameter that ended up with a signal of that log-likelihood gain.
[[nodiscard]] double against_place(double gain, double independent_places);

}  // namespace fit::explain::odds
