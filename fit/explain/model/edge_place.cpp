// SPDX-License-Identifier: MIT
#include "fit/explain/model/edge_place.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace fit::explain::model {
namespace {

/// A stage's resolution, its errors, and what a fit leaves of where mount and targets are.
constexpr double scatters_deg[] = {0.003, 0.015, 0.06};
constexpr double elsewhere = 0.05;  ///< Of captures.
constexpr double widths_of_kernel = 3;

}  // namespace

Kernel::Kernel(double sigma_deg, double step_deg)
    : reach_(static_cast<int>(widths_of_kernel * sigma_deg / step_deg)) {
  for (int k = -reach_; k <= reach_; ++k)
    weights_.push_back(std::exp(-0.5 * std::pow(k * step_deg / sigma_deg, 2)));
  const double all = std::accumulate(weights_.begin(), weights_.end(), 0.0);
  for (double& weight : weights_) weight /= all;
}

std::vector<double> Kernel::smoothed(const std::vector<double>& values) const {
  const int count = static_cast<int>(values.size());
  std::vector<double> sums(values.size());
  for (int i = 0; i < count; ++i)
    for (int k = std::max(-reach_, -i); k <= std::min(reach_, count - 1 - i); ++k)
      sums[static_cast<std::size_t>(i)] +=
          weights_[static_cast<std::size_t>(k + reach_)] * values[static_cast<std::size_t>(i + k)];
  return sums;
}

EdgePlace::EdgePlace(const std::vector<double>& first, double step_deg) {
  const double all = std::accumulate(first.begin(), first.end(), 0.0) * std::ssize(scatters_deg);
  for (const double sigma_deg : scatters_deg) {
    Scatter& scatter = scatter_.emplace_back(Kernel(sigma_deg, step_deg), first);
    for (double& weight : scatter.weights) weight /= all;
  }
}

double EdgePlace::next(const std::vector<double>& here, double anywhere) {
  double all = 0;
  for (Scatter& scatter : scatter_) {
    const std::vector<double> near = scatter.kernel.smoothed(here);
    for (std::size_t i = 0; i < near.size(); ++i)
      all += scatter.weights[i] *= (1 - elsewhere) * near[i] + elsewhere * anywhere;
  }
  if (!(all > 0)) return log_never;
  for (Scatter& scatter : scatter_)
    for (double& weight : scatter.weights) weight /= all;
  return std::log(all);
}

}  // namespace fit::explain::model
