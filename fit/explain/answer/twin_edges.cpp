// SPDX-License-Identifier: MIT
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>

#include "fit/bench/empirical.hpp"
#include "fit/explain/answer/twin.hpp"
#include "fit/explain/inference/runs.hpp"
#include "fit/explain/reduction/seen_edges.hpp"

namespace fit::explain {
namespace {

constexpr std::size_t knots_at_most = 600;
constexpr double finest_deg = 0.002;

/// The end of a target goes to where the recording sees it: brighter surfaces seem wider, and where they end
/// nobody measured to a tenth of a degree.
void move_end(Bench& bench, int id, const SeenEdge& edge) {
  Target& target = bench.targets[static_cast<std::size_t>(id / 2)];
  if (target.round) return;
  const double bearing = edge.bearing_rad + edge.near_side * edge.shift_deg * rad_per_deg;
  const Eigen::Vector2d ray(std::cos(bearing), std::sin(bearing)),
      along = (target.to_mm - target.from_mm).normalized();
  const double facing = ray.x() * along.y() - ray.y() * along.x();
  if (std::abs(facing) < 0.1) return;
  const Eigen::Vector2d way = edge.from - target.from_mm;
  const Eigen::Vector2d place = target.from_mm + (ray.x() * way.y() - ray.y() * way.x()) / facing * along;
  Eigen::Vector2d& end = id % 2 == 0 ? target.from_mm : target.to_mm;
  if ((place - end).norm() < 0.1 * (target.to_mm - target.from_mm).norm()) end = place;
}

}  // namespace

void describe_edges(const Reduced& reduced, const MeanResult& means, bool mixed, Bench& bench) {
  const std::map<int, SeenEdge> edges =
      seen_edges(reduced, means.best.nuisance, all_at_work(reduced.bench, means.best));
  double merged_mm = 0, parted_mm = 1e9;
  double low = 0, high = 0;                          // where beams meet both surfaces
  std::map<long, std::pair<double, double>> places;  // finest steps: share times weight, weight
  for (const auto& [id, edge] : edges) {
    if (!edge.settled) continue;
    move_end(bench, id, edge);
    int between = 0, doubtful = 0;
    for (const Beside& b : edge.beams) {
      const double inside = b.inside_deg - edge.shift_deg;
      if (std::abs(inside) > edge_reach_deg) continue;
      auto& [sum, weight] = places[std::lround(inside / finest_deg)];
      sum += b.n * b.place;
      weight += b.n;
      const double off = std::abs(b.place - (inside > 0 ? 0 : 1));
      if (off > std::max(0.001, 3 * b.u_place)) {
        low = std::min(low, inside);
        high = std::max(high, inside);
      }
      if (b.far_share < 0.1 || b.far_share > 0.9) continue;
      ++doubtful;
      between += b.between;
    }
    if (doubtful == 0) continue;
    if (2 * between > doubtful)
      merged_mm = std::max(merged_mm, edge.gap_mm);
    else
      parted_mm = std::min(parted_mm, edge.gap_mm);
  }
  if (!mixed || places.empty()) return;
  EmpiricalFunction curve{"edge_distance_deg", "far_share", "", {}, {}};
  const auto within = [&](long place) {
    const double inside = static_cast<double>(place) * finest_deg;
    return inside >= low - finest_deg && inside <= high + finest_deg;
  };
  std::vector<WeighedValue> list;
  for (const auto& [place, entry] : places)
    if (within(place))
      list.push_back({static_cast<double>(place) * finest_deg, entry.first / entry.second, entry.second});
  const std::size_t each = 1 + list.size() / knots_at_most;
  RunMeans shares = means_over_runs(std::move(list), each);
  for (double& share : shares.value) share = std::clamp(share, 0.0, 1.0);
  curve.at = std::move(shares.at);
  curve.value = std::move(shares.value);
  if (curve.at.size() < 4) return;
  add_empirical(bench, curve);
  if (merged_mm > 0)
    state_merging(bench, parted_mm > merged_mm ? std::min(1.5 * merged_mm, (merged_mm + parted_mm) / 2)
                                               : merged_mm + 1);
  else if (parted_mm < 1e9)
    state_merging(bench, 0.7 * parted_mm);
}

}  // namespace fit::explain
