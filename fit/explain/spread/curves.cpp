// SPDX-License-Identifier: MIT
#include "fit/explain/spread/curves.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace fit::explain::spread {

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
