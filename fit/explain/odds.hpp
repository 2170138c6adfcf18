// SPDX-License-Identifier: MIT
#pragma once

/// What rooms beside the model believe before the recording is looked at, in logarithms of odds.
namespace fit::explain::odds {

constexpr double price_of_mechanism = 4.0;    // log odds against any one of the catalogue
constexpr double something_is_missing = 1.8;  // whoever asks suspects something
/// Against one mechanism of the catalogue, asked for by itself.
constexpr double against_any = price_of_mechanism - something_is_missing;
constexpr double close_behind = 3.5;  // within this suspects are not told apart

}  // namespace fit::explain::odds
