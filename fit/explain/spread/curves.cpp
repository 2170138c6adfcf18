// SPDX-License-Identifier: MIT
#include "fit/explain/spread/curves.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "fit/explain/spread/ids.hpp"
#include "fit/explain/spread/suspects.hpp"

namespace fit::explain::spread {

namespace {

bool have_place_on(Coordinate coordinate) {
  switch (coordinate) {
    case Coordinate::beam:
    case Coordinate::stage:
    case Coordinate::range:
    case Coordinate::intensity:
    case Coordinate::incidence:
    case Coordinate::time:
      return true;
    default:
      return false;
  }
}

Coordinate drawn_along(const Suspect& noise) {
  return is(noise, ids::angle_jitter)          ? Coordinate::incidence
         : is_constant_noise(*noise.mechanism) ? Coordinate::beam
                                               : noise.mechanism->coordinate;
}

/// Calls `visit(observable, coordinate)` for whatever is found.
template <typename Visit>
void for_each_found(const SpreadResult& result, const Visit& visit) {
  const auto take = [&](const Suspect& s) {
    if (s.mechanism) visit(s.mechanism->observable, drawn_along(s));
  };
  for (const Suspect& s : result.accepted) take(s);
  for (const auto& set : result.undecided)
    for (const Suspect& s : set) take(s);
  for (const Unexplained& u : result.unknown) visit(u.observable, u.coordinate);
}

}  // namespace

std::set<Coordinate> coordinates_of_noise(const SpreadResult& result) {
  std::set<Coordinate> coordinates;
  for_each_found(result, [&](Observable observable, Coordinate coordinate) {
    if (observable == Observable::range_variance && have_place_on(coordinate)) coordinates.insert(coordinate);
  });
  return coordinates;
}

void drop_curves_of_nothing(SpreadResult& result) {
  const std::set<Coordinate> noise = coordinates_of_noise(result);
  bool memory = false;
  for_each_found(result, [&](Observable observable, Coordinate) {
    memory = memory || observable == Observable::time_correlation;
  });
  std::erase_if(result.curves, [&](const SpreadCurve& curve) {
    if (curve.observable == Observable::time_correlation) return !memory;
    return curve.observable == Observable::range_variance && have_place_on(curve.coordinate) &&
           !noise.contains(curve.coordinate);
  });
}

SpreadCurve scatter_along(const VarianceModel& model, Coordinate coordinate,
                          const std::vector<double>& before, const std::vector<double>& after) {
  constexpr std::size_t points = 30;
  const std::vector<Pool>& pools = model.pools();
  std::vector<std::size_t> order(pools.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::sort(order, {}, [&](std::size_t i) { return place_of(pools[i], coordinate); });
  const double all = std::accumulate(pools.begin(), pools.end(), 0.0,
                                     [](double sum, const Pool& p) { return sum + p.freedom; });
  SpreadCurve curve;
  curve.shows = "standard deviation of a sample";
  curve.unit = "mm";
  curve.coordinate = coordinate;
  double freedom = 0, place = 0, recorded = 0, simulated = 0, explained = 0;
  for (std::size_t k = 0; k < order.size(); ++k) {
    const std::size_t i = order[k];
    const Pool& p = pools[i];
    freedom += p.freedom;
    place += p.freedom * place_of(p, coordinate);
    recorded += p.freedom * p.variance;
    simulated += p.freedom * before[i];
    explained += p.freedom * after[i];
    const bool goes_on =
        k + 1 < order.size() && place_of(pools[order[k + 1]], coordinate) == place_of(p, coordinate);
    if (goes_on || (freedom < all / points && k + 1 < order.size())) continue;
    const double sd = std::sqrt(recorded / freedom);
    curve.add(place / freedom, {sd, sd / std::sqrt(2 * model.worth_of_sample() * freedom)},
              std::sqrt(simulated / freedom), std::sqrt(explained / freedom));
    freedom = place = recorded = simulated = explained = 0;
  }
  return curve;
}

}  // namespace fit::explain::spread
