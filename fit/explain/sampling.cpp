// SPDX-License-Identifier: MIT
#include "fit/explain/sampling.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>
#include <vector>

#include "fit/median.hpp"

namespace fit::explain {
namespace {

std::vector<double> steps_between(const std::set<double>& places) {
  std::vector<double> steps;
  for (auto a = places.begin(), b = std::next(a); b != places.end(); ++a, ++b) steps.push_back(*b - *a);
  return steps;
}

}  // namespace

std::optional<double> stops_apart_deg(const Reduced& reduced) {
  constexpr std::size_t least = 3, most = 400;  // more: it turned
  std::set<double> stops;
  for (const Group& group : reduced.groups) stops.insert(group.stage_rad * deg_per_rad);
  if (stops.size() < least || stops.size() > most) return {};
  return median_of(steps_between(stops));
}

bool looks_slow(double period_deg, double spacing_deg) {
  constexpr double slow_deg = 180;
  const double periods = spacing_deg / period_deg, left = std::abs(periods - std::round(periods));
  return periods > 0.5 && spacing_deg > slow_deg * left;
}

std::optional<double> rung_mm(const Reduced& reduced) {
  std::set<double> places;
  for (const CaptureInfo& capture : reduced.captures)
    if (capture.target) places.insert(capture.target_shift_mm);
  if (places.size() < 5) return {};
  const std::vector<double> apart = steps_between(places);
  const auto [least, most] = std::ranges::minmax(apart);
  if (most > 1.02 * least) return {};
  return least;
}

}  // namespace fit::explain
