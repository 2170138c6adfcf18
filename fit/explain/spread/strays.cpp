// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "fit/explain/odds.hpp"
#include "fit/explain/spread/questions.hpp"
#include "fit/explain/spread/suspects.hpp"
#include "fit/mean.hpp"
#include "fit/median.hpp"

namespace fit::explain::spread {
namespace {

/// Samples beside their target, on one side of it: not what dust, another lidar or a ghost makes.
struct Tail {
  bool late = false;
  double mean_mm = 0;  ///< From where the target's own samples end.
  double gain = 0;     ///< Of the log-likelihood, over strays of the catalogue.
};

/// Log-likelihood of places that fall off from zero as an exponential.
double of_exponential(const std::vector<double>& places_mm) {
  const double mean = std::max(1.0, mean_of(places_mm));
  return -static_cast<double>(places_mm.size()) * (std::log(mean) + 1);
}

/// ... that are anywhere up to where each might lie at most; ... that are a ghost's, all at one range.
double of_anywhere(const std::vector<double>& room_mm) {
  double sum = 0;
  for (const double room : room_mm) sum -= std::log(std::max(1.0, room));
  return sum;
}
double of_ghost(const std::vector<double>& ranges_mm) {
  const double middle = median_of(std::vector(ranges_mm));
  std::vector<double> away;
  for (const double r : ranges_mm) away.push_back(std::abs(r - middle));
  const double mean = std::max(1.0, mean_of(away));
  return -static_cast<double>(away.size()) * (std::log(2 * mean) + 1);
}

/// Strays on one side of their targets. Those that lie anywhere lie as far as any does: to the farthest range
/// that came, or to the nearest.
std::optional<Tail> tail_of(const Reduced& reduced, bool late) {
  constexpr std::size_t fewest = 5;
  std::vector<double> places_mm, ranges_mm, room_mm;
  if (reduced.strays_mm.empty()) return {};
  const double end_mm = late ? std::ranges::max(reduced.strays_mm) : std::ranges::min(reduced.strays_mm);
  for (std::size_t i = 0; i < reduced.strays_mm.size(); ++i) {
    const double range = reduced.strays_mm[i], target = range / reduced.strays_of_target[i];
    if ((range > target) != late) continue;
    places_mm.push_back(std::abs(range - target));
    ranges_mm.push_back(range);
    room_mm.push_back(std::abs(end_mm - target));
  }
  if (places_mm.size() < fewest) return {};
  const double nearest = *std::ranges::min_element(places_mm);
  for (double& place : places_mm) place -= nearest;
  for (double& room : room_mm) room -= nearest;
  const double of_catalogue = std::max(of_anywhere(room_mm), of_ghost(ranges_mm));
  return Tail{late, mean_of(places_mm), of_exponential(places_mm) - of_catalogue};
}

/// The side with the more evident tail.
std::optional<Tail> tail_of(const Reduced& reduced) {
  std::optional<Tail> best;
  for (const bool late : {false, true}) {
    const auto tail = tail_of(reduced, late);
    if (tail && (!best || tail->gain > best->gain)) best = tail;
  }
  return best;
}

}  // namespace

void strays(const Reduced& reduced, SpreadResult& result) {
  double strays = 0, beside = 0, samples = 0;
  for (const Cell& cell : reduced.cells) {
    if (!cell.smooth || reduced.groups[static_cast<std::size_t>(cell.group)].scans < 4) continue;
    // A wide beam meets what stands behind an edge from farther away than most: no stray.
    constexpr double reach_rad = 1.2 * rad_per_deg;
    if (cell.at.gap_mm != 0 && std::abs(cell.at.edge_rad) < reach_rad) continue;
    strays += cell.far;
    beside += cell.beside;
    samples += cell.n + cell.stray;
  }
  if (samples < 100) return;
  Suspect suspect = suspected(ids::outliers);
  suspect.gain = 4 * strays;  // each lies where the noise leaves less than e^-18; distances are log-uniform
  suspect.evidence = suspect.gain - 4;
  // Those that fell among the target's own samples are taken for as many as fell just beside these, which are
  // counted twice therefore.
  const double variance = strays + 3 * beside + 0.25;
  suspect.parameters = {{"fraction", {(strays + beside) / samples, std::sqrt(variance) / samples}}};
  if (suspect.evidence <= accept_rare_at) return;
  const auto tail = tail_of(reduced);
  if (!tail || tail->gain < -odds::close_behind) {
    result.accepted.push_back(suspect);
    return;
  }
  if (tail->gain < odds::price_of_unknown) {
    result.undecided.push_back({suspect, Suspect{}});
    return;
  }
  Unexplained u;
  u.observable = Observable::range_distribution;
  u.coordinate = Coordinate::target;
  u.gain = suspect.gain;
  u.evidence = tail->gain;
  u.describes =
      std::string("samples have a tail: beyond what noise explains, some come ") +
      (tail->late ? "late" : "early") + ", by " + rounded(tail->mean_mm, 2) +
      " mm more on average and ever more rarely the farther; strays would lie anywhere, or at one range";
  result.unknown.push_back(u);
}

}  // namespace fit::explain::spread
