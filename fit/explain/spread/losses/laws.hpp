// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <optional>

#include "fit/explain/spread/losses/counts.hpp"
#include "fit/explain/spread/spans_of_time.hpp"

/// By which law echoes may be lost: each with its log-likelihood at its best parameters.
namespace fit::explain::spread {

constexpr double rarest = 1e-6;  // probability of no echo: so many are lost whatever the cause

/// A probability within what can be.
[[nodiscard]] double clamped(double probability);

/// Of losing each with the same probability.
[[nodiscard]] double constant_likelihood(const Counts& counts);

/// Echoes weaker than `at` counts are lost.
struct Threshold {
  double log_likelihood = 0;
  double at = 0, width = 0;
};
/// Probability of losing an echo if those below `at` are lost, more and more within `width`.
[[nodiscard]] double lost_below(double at, double width, double intensity);
[[nodiscard]] double likelihood_of_threshold(const Counts& counts, double at, double width);
/// The best one, if any is better than a constant probability.
[[nodiscard]] Threshold best_threshold(const Counts& counts, double constant);

/// Beams around `centre_deg` lose more, or less, than all others.
struct Window {
  double log_likelihood = 0;
  double centre_deg = 0;
  double elsewhere = 0;  ///< Samples lost by the others.
};
/// The best one, if any is better than a constant probability.
[[nodiscard]] Window best_window(const Counts& counts, double constant);

/// More are lost from one time to another, around a beam angle or at all.
struct WindowInTime {
  double log_likelihood = 0;
  PlaceAndTimes where_and_when;
  double elsewhere = 0;      ///< Samples lost by others, or at other times.
  std::size_t captures = 0;  ///< That take part.
};
/// The best one, its price paid; none where there are not several times, or too many to try.
[[nodiscard]] std::optional<WindowInTime> best_window_in_time(const Counts& counts);

/// Whether echoes as weak as most of those lost within, or weaker, come back elsewhere or at other times.
[[nodiscard]] bool as_weak_come_back(const WindowInTime& window, const Counts& counts);

}  // namespace fit::explain::spread
