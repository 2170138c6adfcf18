// SPDX-License-Identifier: MIT
#include "fit/explain/spread/light_at_times.hpp"

#include <algorithm>
#include <set>
#include <vector>

#include "fit/explain/spread/as_weak_elsewhere.hpp"
#include "fit/explain/spread/noise_columns.hpp"

namespace fit::explain::spread {
namespace {

constexpr std::size_t most_times = 120;

std::vector<Place> places_of(const std::vector<Pool>& pools) {
  std::vector<Place> places{{.everywhere = true}};
  const auto [low, high] = std::ranges::minmax(pools, {}, &Pool::beam_deg);
  for (const double width : {5.0, 9.0, 16.0, 28.0})
    for (double c = low.beam_deg; c <= high.beam_deg; c += 0.8 * width)
      places.push_back({.centre_deg = c, .width_deg = width});
  return places;
}

Column column_of(const std::vector<Pool>& pools, const Place& place) {
  return place.everywhere ? Column(pools.size(), 1) : of_light(pools, place.centre_deg, place.width_deg);
}

/// What the gain of a size would be, from its score and information: the square of one over the other.
std::optional<double> gain_of(const Sums& sums) {
  const double score = sums[0], information = sums[1];
  if (score <= 0 || !(information > 0)) return {};
  return score * score / information;
}

std::size_t captures_between(const std::vector<Pool>& pools, Interval times_s) {
  std::set<int> captures;
  for (const Pool& p : pools)
    if (p.time_s >= times_s.from && p.time_s <= times_s.to) captures.insert(p.capture);
  return captures.size();
}

}  // namespace

std::optional<LightAtTimes> light_at_times(const VarianceModel& model, const std::vector<double>& variances) {
  const std::vector<Pool>& pools = model.pools();
  std::set<double> different_s;
  for (const Pool& p : pools) different_s.insert(p.time_s);
  const Times times(different_s, most_times);
  const auto sums_at = [&](const Place& place) {
    const Column column = column_of(pools, place);
    std::vector<Sums> sums(times.count(), Sums::Zero());
    for (std::size_t i = 0; i < pools.size(); ++i) {
      const double v = variances[i], w = model.worth_of_sample() * pools[i].freedom / (2 * v * v);
      sums[times.index_of(pools[i].time_s)] +=
          Sums(w * column[i] * (pools[i].variance - v), w * column[i] * column[i]);
    }
    return sums;
  };
  const auto best = best_span(times, places_of(pools), {sums_at, gain_of, 1});
  if (!best) return {};
  return LightAtTimes{best->where_and_when, static_cast<double>(times.count() * (times.count() + 1)) / 2,
                      captures_between(pools, best->where_and_when.times_s)};
}

bool reaches_no_weaker_echoes(const std::vector<Pool>& pools, const Column& column) {
  constexpr double without_light = 0.1;
  std::vector<Echoes> reached;
  std::vector<double> elsewhere;
  for (std::size_t i = 0; i < pools.size(); ++i)
    if (column[i] < without_light)
      elsewhere.push_back(pools[i].intensity);
    else
      reached.push_back({pools[i].intensity, pools[i].freedom * column[i]});
  return is_as_weak_elsewhere(reached, elsewhere);
}

}  // namespace fit::explain::spread
