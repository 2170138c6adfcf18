// SPDX-License-Identifier: MIT
#include "fit/explain/inference/peak.hpp"

#include <nlopt.h>

#include <algorithm>
#include <cmath>
#include <iterator>

#include "fit/numeric/angle.hpp"

namespace fit::explain::inference {
namespace {

using LogEvidence = std::function<double(const std::vector<double>&)>;

/// The places of all starts along a parameter, in order.
std::vector<double> places_of(const std::vector<std::vector<double>>& starts, std::size_t parameter) {
  std::vector<double> places;
  for (const auto& start : starts) places.push_back(start[parameter]);
  std::ranges::sort(places);
  places.erase(std::unique(places.begin(), places.end()), places.end());
  return places;
}

/// Of the starts between which a place is; 0: there is one only.
double distance_at(const std::vector<double>& places, double value) {
  if (places.size() < 2) return 0;
  const auto above = std::ranges::upper_bound(places, value);
  const auto next = std::clamp<std::ptrdiff_t>(above - places.begin(), 1, std::ssize(places) - 1);
  return places[static_cast<std::size_t>(next)] - places[static_cast<std::size_t>(next - 1)];
}

/// Half of one is lost at a standard deviation to either side.
double standard_width(const Peak& peak, std::size_t parameter, double widest,
                      const LogEvidence& log_evidence) {
  constexpr int most_halvings = 12;
  double width = widest;
  for (int halving = 0; halving < most_halvings; ++halving, width /= 2) {
    double fall = 0;
    for (const double by : {-width, width}) {
      std::vector<double> aside = peak.values;
      aside[parameter] += by;
      fall += peak.log_evidence - log_evidence(aside);
    }
    if (fall < 2) break;
  }
  return width;
}

}  // namespace

Peak peak_between(const std::vector<std::vector<double>>& starts, const std::vector<std::size_t>& parameters,
                  Peak from, const LogEvidence& log_evidence) {
  constexpr int most_halvings = 5;
  const double before = from.log_evidence;
  std::vector<double> distances, first, last;
  for (const std::size_t k : parameters) {
    const std::vector<double> places = places_of(starts, k);
    distances.push_back(distance_at(places, from.values[k]));
    first.push_back(places.front());
    last.push_back(places.back());
  }
  for (int halving = 1; halving <= most_halvings; ++halving)
    for (std::size_t j = 0; j < parameters.size(); ++j) {
      const double step = distances[j] / (1 << halving);
      for (const double by : {-step, step}) {
        std::vector<double> aside = from.values;
        double& place = aside[parameters[j]];
        place += by;
        if (step == 0 || place < first[j] || place > last[j]) continue;
        const double there = log_evidence(aside);
        if (there <= from.log_evidence) continue;
        from.log_evidence = there;
        from.values = std::move(aside);
        break;
      }
    }
  if (from.log_evidence <= before) return from;
  const double gaussian = std::sqrt(2 * pi);
  for (std::size_t j = 0; j < parameters.size(); ++j) {
    if (distances[j] == 0) continue;
    const double width = standard_width(from, parameters[j], distances[j] / gaussian, log_evidence);
    from.log_share += std::log(width * gaussian / distances[j]);
  }
  return from;
}

Peak peak_among(const std::vector<double>& borders, const std::vector<std::size_t>& parameters, Peak from,
                const LogEvidence& log_evidence) {
  constexpr std::ptrdiff_t aside = 12;
  constexpr int rounds = 2;
  from.log_share = 0;
  for (int round = 0; round < rounds; ++round)
    for (const std::size_t end : parameters) {
      const auto near = std::ranges::lower_bound(borders, from.values[end]);
      const auto first = near - std::min(aside, near - borders.begin()),
                 last = near + std::min(aside, borders.end() - near);
      for (auto border = first; border != last; ++border) {
        std::vector<double> other = from.values;
        other[end] = *border;
        const double there = log_evidence(other);
        if (there <= from.log_evidence) continue;
        from.log_evidence = there;
        from.values = std::move(other);
      }
    }
  return from;
}

void climb(const std::vector<Free>& free, double before,
           const std::function<double(const double* x)>& function) {
  struct Context {
    const std::function<double(const double*)>& function;
    double most;
  } context{function, -1e300};
  std::vector<double> x, lower, upper, first;
  for (const Free& one : free) {
    x.push_back(one.at);
    lower.push_back(one.lower);
    upper.push_back(one.upper);
    first.push_back(one.first);
  }
  const auto count = static_cast<unsigned>(free.size());
  nlopt_opt optimiser = nlopt_create(NLOPT_LN_NELDERMEAD, count);
  nlopt_set_lower_bounds(optimiser, lower.data());
  nlopt_set_upper_bounds(optimiser, upper.data());
  nlopt_set_initial_step(optimiser, first.data());
  nlopt_set_maxeval(optimiser, 15 + 15 * static_cast<int>(count));
  nlopt_set_ftol_abs(optimiser, 0.02);
  nlopt_set_max_objective(
      optimiser,
      [](unsigned, const double* at, double*, void* data) {
        auto& c = *static_cast<Context*>(data);
        const double value = c.function(at);
        c.most = std::max(c.most, value);
        return value;
      },
      &context);
  constexpr int most_runs = 4;
  double value = 0;
  for (int run = 0; run < most_runs; ++run) {  // A simplex that got somewhere may have been cut short.
    nlopt_optimize(optimiser, x.data(), &value);
    if (!(context.most > before + 1)) break;
    before = context.most;
    for (double& step : first) step /= 2;
    nlopt_set_initial_step(optimiser, first.data());
  }
  nlopt_destroy(optimiser);
}

}  // namespace fit::explain::inference
