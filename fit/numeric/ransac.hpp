// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <random>
#include <vector>

namespace fit {

struct RansacOptions {
  double tolerance = 20;  ///< Of the distance between a sample and the model.
  int tries = 500;        ///< At most; fewer once a better model is improbable.
  unsigned seed = 1;      ///< The same samples give the same answer.
};

template <class Model>
struct RansacResult {
  Model model;
  std::vector<std::size_t> inliers;  ///< In ascending order; empty when no model was found.
};

/// The model that most of `count` samples agree with (Fischler and Bolles 1981). `propose(indices)` makes a
/// model of `needed` samples and returns false when they make none; `distance(model, index)` judges one
/// sample. Among models with equally many inliers the one with the smaller sum of distances wins.
template <class Model, class Propose, class Distance>
RansacResult<Model> ransac(std::size_t count, std::size_t needed, const RansacOptions& options,
                           Propose&& propose, Distance&& distance) {
  RansacResult<Model> best;
  if (count < needed) return best;
  std::mt19937 random(options.seed);
  std::vector<std::size_t> chosen(needed);
  double best_sum = 0, tries = options.tries;
  for (int i = 0; i < tries; ++i) {
    for (std::size_t k = 0; k < needed; ++k) {
      do chosen[k] = random() % count;
      while (std::find(chosen.begin(), chosen.begin() + static_cast<std::ptrdiff_t>(k), chosen[k]) !=
             chosen.begin() + static_cast<std::ptrdiff_t>(k));
    }
    Model model;
    if (!propose(chosen, model)) continue;
    std::vector<std::size_t> inliers;
    double sum = 0;
    for (std::size_t k = 0; k < count; ++k) {
      const double d = distance(model, k);
      if (!(d <= options.tolerance)) continue;
      inliers.push_back(k);
      sum += d;
    }
    if (inliers.size() < best.inliers.size() || inliers.size() < needed) continue;
    if (inliers.size() == best.inliers.size() && sum >= best_sum) continue;
    best = {model, std::move(inliers)};
    best_sum = sum;
    // Enough tries that all chosen samples were inliers at least once with probability 0.9999.
    const double share = static_cast<double>(best.inliers.size()) / static_cast<double>(count);
    const double all_in = std::pow(share, static_cast<double>(needed));
    if (all_in > 0.9999) break;
    tries = std::min<double>(options.tries, std::max(20.0, std::log(1e-4) / std::log(1 - all_in)));
  }
  return best;
}

}  // namespace fit
