// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "fit/explain/spread/variance_model.hpp"
#include "fit/mechanism.hpp"

namespace fit::explain::spread {

/// Noise that follows one coordinate by no law of the catalogue: another factor of the variance in every
/// interval of it, or between two of its values.
struct UnnamedNoise {
  Coordinate coordinate = Coordinate::beam;
  double gain = 0;   ///< Of the log-likelihood, beside the variances it was sought with.
  double price = 0;  ///< Of its sizes and places, and of all forms that were tried.
  /// What it gains in captures that it was not fitted to, each with its own constant noise; not known with
  /// fewer than three, or if it is the same within a capture.
  std::optional<double> unseen_gain;
  struct Interval {
    double from = 0, to = 0, sigma_mm = 0;
  };
  Interval most, least;     ///< Where samples scatter most and least, file unit of the coordinate.
  bool only_there = false;  ///< All else is like the least.

  [[nodiscard]] double evidence() const { return gain - price; }
};

/// The one that explains most of what `variances` (mm^2, of the model's pools) leave, and that captures which
/// it was not fitted to confirm. `places_differ`: captures have constant noise of their own, which then tells
/// nothing about what is the same within a capture.
[[nodiscard]] std::optional<UnnamedNoise> unnamed_noise(const VarianceModel& model,
                                                        const std::vector<double>& variances,
                                                        bool places_differ);

/// For people; `targets`: their names.
[[nodiscard]] std::string in_words(const UnnamedNoise& noise, const std::vector<std::string>& targets);

}  // namespace fit::explain::spread
