// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace fit::explain::model {

/// Log of the likelihood of something that cannot be.
inline constexpr double log_never = -1e4;

/// Places a step apart.
struct PlaceGrid {
  double from_deg = 0, step_deg = 0;
  std::size_t count = 0;

  PlaceGrid(double first_deg, double last_deg, double apart_deg)
      : from_deg(first_deg),
        step_deg(apart_deg),
        count(static_cast<std::size_t>(std::max(0.0, last_deg - first_deg) / apart_deg) + 1) {}
  [[nodiscard]] double at(std::size_t i) const { return from_deg + static_cast<double>(i) * step_deg; }
};

/// Normal weights of neighbouring places, the sum of which is 1.
class Kernel {
 public:
  Kernel(double sigma_deg, double step_deg);
  /// The weighted sum around every place.
  [[nodiscard]] std::vector<double> smoothed(const std::vector<double>& values) const;

 private:
  int reach_;
  std::vector<double> weights_;
};

/// Where an edge stands against its place in the bench, as a grid of places: at one in all captures, but
/// stage and fit may have each capture's elsewhere by a normal error of unknown size, and now and then by
/// anything. Its place is integrated over, capture by capture.
class EdgePlace {
 public:
  /// Takes the prior times the likelihood of the first capture, at places a step apart.
  EdgePlace(const std::vector<double>& first, double step_deg);
  /// Log-likelihood of the next capture given all before. Takes its likelihood at every place, and where the
  /// edge may be anywhere.
  [[nodiscard]] double next(const std::vector<double>& here, double anywhere);

 private:
  struct Scatter {
    Kernel kernel;
    std::vector<double> weights;  ///< Of places.
  };
  std::vector<Scatter> scatter_;
};

}  // namespace fit::explain::model
