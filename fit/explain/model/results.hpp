// SPDX-License-Identifier: MIT
#pragma once

#include <map>
#include <string>
#include <vector>

#include "fit/explain/model/hypothesis.hpp"
#include "fit/explain/numbers.hpp"

namespace fit::explain {

/// A suspect that acts on something other than the cells' means, as it came out.
struct Suspect {
  const Mechanism* mechanism = nullptr;  ///< Null: something outside the catalogue.
  std::map<std::string, Estimate> parameters;
  int target = -1;  ///< The only one on which it acts; -1: all.
  double gain = 0;  ///< Of the log-likelihood.
};

/// One of the hypotheses that count, as far as it says what happens in other recordings.
struct Alternative {
  double probability = 1;
  std::vector<Suspect> mechanisms;
};

/// Something that no mechanism of the catalogue explains.
struct Unexplained {
  Observable observable = Observable::range_mean;
  Coordinate coordinate = Coordinate::beam;
  std::string describes;
  double gain = 0;
  double from = 0, to = 0;
};

/// A picture for people of what whole scans, noise, echoes or memory do along a coordinate: as recorded, as
/// simulated before anything was explained, and as explained.
struct SpreadCurve {
  std::string shows, unit;  ///< What is drawn: "scatter of samples" in "mm".
  Observable observable = Observable::range_variance;
  Coordinate coordinate = Coordinate::beam;
  std::string along;       ///< What is drawn against, if the coordinate's name does not say it.
  std::vector<double> at;  ///< File unit of the coordinate.
  std::vector<double> recorded, sigma, before, after;

  void add(double place, const Estimate& seen, double simulated, double explained) {
    at.push_back(place);
    recorded.push_back(seen.value);
    sigma.push_back(seen.u);
    before.push_back(simulated);
    after.push_back(explained);
  }
};

struct HeldOutFigures {
  double log_likelihood = 0, rms_mm = 0, coverage = 0, cells = 0;
};

/// What the means came to.
struct MeanResult {
  explicit MeanResult(const Bench& bench) : best(bench) {}
  Hypothesis best;
  bool shapes_carry_over = true;  ///< To captures that had no part in them.
  HeldOutFigures before, after;   ///< The log-likelihood is of all channels.
  /// Held-out captures lie farther off with what was found than without.
  [[nodiscard]] bool is_worse_held_out() const { return after.rms_mm > 1.1 * before.rms_mm; }
  HeldOutFigures without_functions;  ///< Of names alone; as `after` where no function is.
  /// What functions without a name would have to explain is more than lidars err by, in most of what was
  /// seen.
  [[nodiscard]] bool is_another_scene() const {
    return without_functions.rms_mm > numbers::another_scene_mm &&
           without_functions.coverage < numbers::describes_at;
  }
  double noise_floor_mm = 0;
  double excess = 1;  ///< Factor on the variance of the means.
  MeanNoise noise;
};

}  // namespace fit::explain
