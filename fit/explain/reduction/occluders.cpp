// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/occluders.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "fit/explain/reduction/margins.hpp"

namespace fit::explain::reduction {
namespace {

constexpr int fewest_beams = 5;   // side by side: less may be dust, or an edge
constexpr double rough_mm = 150;  // one thing: no farther apart than this are neighbours
constexpr double before_mm = 100, before_sigma = 12;

/// The farthest that every beam sees of what may be its target; 0 where there is none.
std::vector<double> farthest_of_targets(const Samples& samples, const Scene& scene, double stage_rad) {
  std::vector<double> farthest_mm(samples.beam_rad.size(), 0.0);
  for (int beam = 0; beam < samples.beams; ++beam) {
    const Sight sight = scene.look(stage_rad, samples.beam_rad[static_cast<std::size_t>(beam)]);
    if (sight.target < 0) continue;
    double& farthest = farthest_mm[static_cast<std::size_t>(beam)];
    for (int scan = 0; scan < samples.scans; ++scan)
      if (const double range_mm = samples.at(scan, beam); range_mm < sight.range_mm + off_target_mm)
        farthest = std::max(farthest, range_mm);
  }
  return farthest_mm;
}

double nearer_mm(double sigma_mm) { return std::max(before_mm, before_sigma * sigma_mm); }

/// Runs of neighbours, of so many, that are before their targets: the first and the one behind the last, with
/// those beside them, which meet it in part.
template <class IsBefore, class Range>
std::vector<std::pair<int, int>> things_before(int count, const IsBefore& is_before, const Range& range_mm) {
  constexpr int beside = 2;
  std::vector<std::pair<int, int>> things;
  for (int first = 0, end = 0; first < count; first = std::max(end, first + 1)) {
    for (end = first; end < count && is_before(end); ++end)
      if (end > first && std::abs(range_mm(end) - range_mm(end - 1)) > rough_mm) break;
    if (end - first >= fewest_beams)
      things.emplace_back(std::max(0, first - beside), std::min(count, end + beside));
  }
  return things;
}

/// One more scan in which something stood at these beams, where another may have had it, too.
void join(Occluder one, std::vector<Occluder>& occluders) {
  constexpr double beside_rad = 2 * rad_per_deg;
  std::erase_if(occluders, [&](const Occluder& other) {
    if (other.from_rad > one.to_rad + beside_rad || other.to_rad < one.from_rad - beside_rad) return false;
    one = {0, std::min(one.from_rad, other.from_rad), std::max(one.to_rad, other.to_rad)};
    return true;
  });
  occluders.push_back(one);
}

/// What the cells of one target are, over all captures.
struct Seen {
  int all = 0, nearer = 0;
};

/// Whether the target goes on beside what stands before it, on every side where that is seen: one that is
/// elsewhere itself, or turned, has no such steps.
bool stands_out(std::span<const Cell> cells, int first, int end) {
  constexpr int beside = 3;
  const auto at = [&](int i) -> const Cell& { return cells[static_cast<std::size_t>(i)]; };
  int steps = 0;
  for (const auto& [inner, outer] :
       {std::pair(first + beside, first - beside), std::pair(end - 1 - beside, end - 1 + beside)}) {
    if (outer < 0 || outer >= static_cast<int>(cells.size()) || inner < first || inner >= end) continue;
    if (at(outer).at.target != at(inner).at.target || at(outer).n == 0) continue;
    if (2 * std::abs(at(outer).off_mm()) > std::abs(at(inner).off_mm())) return false;
    ++steps;
  }
  return steps > 0;
}

}  // namespace

std::vector<Occluder> occluders_in(const Samples& samples, const Scene& scene, double stage_rad,
                                   double sigma_mm) {
  std::vector<Occluder> occluders;
  if (samples.scans < 2) return occluders;
  const std::vector<double> farthest_mm = farthest_of_targets(samples, scene, stage_rad);
  for (int scan = 0; scan < samples.scans; ++scan) {
    const auto range_mm = [&](int beam) { return samples.at(scan, beam); };
    const auto is_before = [&](int beam) {
      return is_echo(range_mm(beam)) &&
             range_mm(beam) < farthest_mm[static_cast<std::size_t>(beam)] - nearer_mm(sigma_mm);
    };
    for (const auto& [first, end] : things_before(samples.beams, is_before, range_mm))
      join({0, samples.beam_rad[static_cast<std::size_t>(first)],
            samples.beam_rad[static_cast<std::size_t>(end - 1)]},
           occluders);
  }
  return occluders;
}

std::vector<Occluder> standing_occluders(const Reduced& reduced) {
  const Mount& mount = reduced.bench.lidar.mount;
  // Millimetres by which a cell is off for sure; beside an edge it may meet the other surface.
  const auto off_mm = [&](const Cell& cell) {
    const double least_mm = nearer_mm(reduced.group_of(cell).sigma_mm) +
                             coverage_of_mount * misplaced_mm(reduced.bench, cell.sight);
    const double off = cell.off_mm(), range_mm = cell.sight.range_mm;
    const bool beside_edge = std::abs(cell.at.edge_rad) <
                             beside_rad + place_uncertainty_mm(mount, range_mm, coverage_of_mount) / range_mm;
    return cell.n == 0 || beside_edge || std::abs(off) < least_mm ? 0 : off;
  };
  std::map<int, Seen> of_target;
  for (const Cell& cell : reduced.cells) {
    Seen& seen = of_target[cell.at.target];
    ++seen.all;
    seen.nearer += off_mm(cell) < 0;
  }
  constexpr int few = 4;  // a quarter
  std::vector<Occluder> list;
  for (const Group& group : reduced.groups) {
    const auto cells = reduced.cells_of(group);
    const auto at = [&](int i) -> const Cell& { return cells[static_cast<std::size_t>(i)]; };
    const auto is_before = [&](int i) { return off_mm(at(i)) < 0; };
    auto things =
        things_before(static_cast<int>(cells.size()), is_before, [&](int i) { return at(i).mean_mm; });
    std::erase_if(things, [&](const std::pair<int, int>& thing) {
      const Seen& seen = of_target.at(at((thing.first + thing.second) / 2).at.target);
      return few * seen.nearer >= seen.all && !stands_out(cells, thing.first, thing.second);
    });
    const auto farther = std::ranges::count_if(cells, [&](const Cell& cell) { return off_mm(cell) > 0; });
    long hidden = 0;
    for (const auto& [first, end] : things) hidden += end - first;
    if (few * farther > hidden) continue;
    for (const auto& [first, end] : things) {
      const Cell& middle = at((first + end) / 2);
      const double bearing = middle.sight.bearing_rad;
      list.push_back(
          {group.capture, at(first).beam_rad, at(end - 1).beam_rad,
           middle.sight.origin + middle.mean_mm * Eigen::Vector2d(std::cos(bearing), std::sin(bearing))});
    }
  }
  return list;
}

}  // namespace fit::explain::reduction
