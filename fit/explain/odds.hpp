// SPDX-License-Identifier: MIT
#pragma once

/// What rooms beside the model believe before the recording is looked at, in logarithms of odds.
namespace fit::explain::odds {

constexpr double price_of_mechanism = 4.0;    // log odds against any one of the catalogue
constexpr double price_of_unknown = 7.0;      // the catalogue is tried first
constexpr double something_is_missing = 1.8;  // whoever asks suspects something
/// Against one mechanism of the catalogue, asked for by itself.
constexpr double against_any = price_of_mechanism - something_is_missing;
constexpr double close_behind = 3.5;  // within this suspects are not told apart
constexpr double strained = 4.5;      // log of the odds at which stated uncertainties are not believed

}  // namespace fit::explain::odds
