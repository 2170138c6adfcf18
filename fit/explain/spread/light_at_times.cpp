// SPDX-License-Identifier: MIT
#include "fit/explain/spread/light_at_times.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>
#include <utility>
#include <vector>

#include "fit/explain/spread/noise_columns.hpp"

namespace fit::explain::spread {
namespace {

/// Score and information of a size, summed over pools up to a time.
using Sums = std::pair<double, double>;

/// A column for every place that light may come from, and one for everywhere.
struct Place {
  bool everywhere = false;
  double centre_deg = 0, width_deg = 0;
  Column column;
};

std::vector<Place> places_of(const std::vector<Pool>& pools) {
  std::vector<Place> places{{true, 0, 0, Column(pools.size(), 1)}};
  const auto [low, high] = std::ranges::minmax(pools, {}, &Pool::beam_deg);
  for (const double width : {5.0, 9.0, 16.0, 28.0})
    for (double c = low.beam_deg; c <= high.beam_deg; c += 0.8 * width)
      places.push_back({false, c, width, of_light(pools, c, width)});
  return places;
}

}  // namespace

std::optional<LightAtTimes> light_at_times(const VarianceModel& model, const std::vector<double>& variances) {
  const std::vector<Pool>& pools = model.pools();
  std::set<double> different;
  for (const Pool& p : pools) different.insert(p.time_s);
  if (different.size() < 4) return {};
  // A long session's times are taken together: spans are as many as their square.
  constexpr std::size_t most_times = 120;
  const std::vector<double> all(different.begin(), different.end());
  const std::size_t each = (all.size() + most_times - 1) / most_times, times = (all.size() + each - 1) / each;
  const auto time_of = [&](const Pool& p) {
    return static_cast<std::size_t>(std::ranges::lower_bound(all, p.time_s) - all.begin()) / each;
  };
  std::optional<LightAtTimes> best;
  double top = 0;
  std::size_t best_first = 0, best_last = 0;
  for (const Place& place : places_of(pools)) {
    std::vector<Sums> up_to(times + 1);
    for (std::size_t i = 0; i < pools.size(); ++i) {
      const double v = variances[i], w = model.worth_of_sample() * pools[i].freedom / (2 * v * v);
      auto& [score, information] = up_to[time_of(pools[i]) + 1];
      score += w * place.column[i] * (pools[i].variance - v);
      information += w * place.column[i] * place.column[i];
    }
    for (std::size_t t = 0; t < times; ++t) {
      up_to[t + 1].first += up_to[t].first;
      up_to[t + 1].second += up_to[t].second;
    }
    for (std::size_t first = 0; first < times; ++first)
      for (std::size_t last = first; last < times; ++last) {
        if (2 * (last - first + 1) > times) break;  // what is there mostly is told without times
        const double score = up_to[last + 1].first - up_to[first].first,
                     information = up_to[last + 1].second - up_to[first].second;
        if (score <= 0 || !(information > 0) || score * score / information <= top) continue;
        top = score * score / information;
        best = LightAtTimes{place.everywhere, place.centre_deg, place.width_deg};
        best_first = first;
        best_last = last;
      }
  }
  if (!best) return {};
  // It began and ended between two recordings, nobody knows when.
  const std::size_t first = best_first * each, after = std::min(all.size(), (best_last + 1) * each);
  const auto between = [&](std::size_t before) { return std::midpoint(all[before], all[before + 1]); };
  constexpr double aside_s = 1;
  best->times_s = {first > 0 ? between(first - 1) : all.front() - aside_s,
                   after < all.size() ? between(after - 1) : all.back() + aside_s};
  best->u_from_s = first > 0 ? (all[first] - all[first - 1]) / std::sqrt(12.0) : aside_s;
  best->u_to_s = after < all.size() ? (all[after] - all[after - 1]) / std::sqrt(12.0) : aside_s;
  best->places = static_cast<double>(times * (times + 1)) / 2;
  std::set<int> captures;
  for (const Pool& p : pools)
    if (p.time_s >= best->times_s.from && p.time_s <= best->times_s.to) captures.insert(p.capture);
  best->seen = captures.size();
  return best;
}

bool is_as_weak_elsewhere(const std::vector<Pool>& pools, const Column& column) {
  constexpr double without_light = 0.1, hardly_stronger = 1.01;
  double weakest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < pools.size(); ++i)
    if (column[i] < without_light) weakest = std::min(weakest, pools[i].intensity);
  double all = 0, met = 0;
  for (std::size_t i = 0; i < pools.size(); ++i) {
    if (column[i] < without_light) continue;
    all += pools[i].freedom * column[i];
    if (weakest <= hardly_stronger * pools[i].intensity) met += pools[i].freedom * column[i];
  }
  return 2 * met > all;
}

}  // namespace fit::explain::spread
