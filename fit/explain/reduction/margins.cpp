// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/margins.hpp"

#include <algorithm>
#include <cmath>

#include "fit/explain/numbers.hpp"
#include "fit/explain/reduction/effect_there.hpp"
#include "fit/wide_beam.hpp"

namespace fit::explain::reduction {

double place_uncertainty_mm(const Mount& mount, double range_mm, double uncertainties) {
  return uncertainties * (mount.yaw_rad.u * range_mm + std::hypot(mount.x_mm.u, mount.y_mm.u));
}

double misplaced_mm(const Bench& bench, const Sight& sight) {
  const Mount& mount = bench.lidar.mount;
  const Target& target = bench.target_at(sight.target);
  const double across_mm = std::hypot(mount.x_mm.u, mount.y_mm.u, target.u_mm) / sight.cos_incidence();
  return std::hypot(across_mm, sight.beam_sensitivity() * std::hypot(mount.yaw_rad.u, target.u_rad));
}

double corner_margin_mm(const Sight& sight, double place_uncertainty_mm, double half_rad) {
  return 8 + 0.003 * sight.range_mm +
         (place_uncertainty_mm + half_rad * sight.range_mm) / sight.cos_incidence();
}

double u_at_edge_mm(const Sight& sight, double edge_rad, double gap_mm, double width_rad) {
  const double widths = std::abs(edge_rad) / width_rad;
  if (!(widths < 8)) return 0;
  const double passes = 0.5 * std::erfc(widths / std::sqrt(2.0)),
               aside_rad = width_rad * std::exp(-widths * widths / 2) / std::sqrt(2 * pi);
  return std::hypot(sight.beam_sensitivity() * aside_rad, gap_mm * passes);
}

void state_u_of_wide_beams(Reduced& reduced, double width_rad) {
  for (Cell& cell : reduced.cells) {
    const double reach_rad = widths_of_beam * width_rad + half_width_rad(cell),
                 range_mm = cell.sight.range_mm;
    const bool at_edge = std::abs(cell.at.edge_rad) < reach_rad && cell.at.gap_mm > 0,
               at_corner = cell.at.corner_mm * cell.sight.cos_incidence() < reach_rad * range_mm;
    cell.mixed_mm = at_edge     ? cell.at.gap_mm
                    : at_corner ? spread_error * std::abs(spread_at_mm(cell.at, width_rad))
                                : 0;
  }
}

void state_u_of_bin_edges(Reduced& reduced, double bin_mm, double zero, double stop_rad2) {
  constexpr double reach = 3;  // standard deviations
  for (Cell& cell : reduced.cells) {
    const double counted = cell.at.range_mm / bin_mm + zero, place = counted - std::floor(counted),
                 aside_mm = reach * std::abs(cell.sight.stage_sensitivity()) * std::sqrt(stop_rad2);
    if (std::abs(place - 0.5) < numbers::u_of_bin_edge + aside_mm / bin_mm)
      cell.mixed_mm = std::max(cell.mixed_mm, bin_mm / 2);
  }
}

void state_u_of_other_targets(Reduced& reduced, const Nuisance& nuisance,
                              const std::vector<Active>& at_work) {
  const Nuisance there = displaced(reduced, nuisance, at_work);
  for (const Group& group : reduced.groups) {
    const Scene scene = reduced.scene_of(group, there);
    for (Cell& cell : reduced.cells_of(group)) {
      if (!cell.usable) continue;
      const Sight met = scene.look(group.stage_rad, cell.beam_rad, effect_there(reduced, at_work, cell.at));
      if (met.target < 0 || met.target == cell.sight.target) continue;
      cell.mixed_mm = std::max(cell.mixed_mm, std::abs(met.range_mm - cell.sight.range_mm));
    }
  }
}

}  // namespace fit::explain::reduction
