// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/edge_shares.hpp"

#include <span>

#include "fit/explain/reduction/effect_there.hpp"

namespace fit::explain::reduction {

void share_out_again(Reduced& reduced, const Nuisance& fitted, const std::vector<Active>& at_work) {
  const Nuisance nuisance = displaced(reduced, fitted, at_work);
  for (const Group& group : reduced.groups) {
    const Scene scene = reduced.scene_of(group, nuisance);
    const std::vector<Edge> edges = edges_there(reduced, group, scene, at_work);
    for (Cell& cell : reduced.cells_of(group)) {
      const auto edge = std::ranges::find(edges, cell.edge, &Edge::id);
      if (edge == edges.end()) continue;
      const Effect effect = effect_there(reduced, at_work, cell.at);
      const Sight sight = scene.look_at(cell.sight.target, group.stage_rad, cell.beam_rad, effect);
      if (sight.target != cell.sight.target) continue;
      scene.describe(sight, edges, cell.at);
      cell.at.target = reduced.same_as[static_cast<std::size_t>(sight.target)];
      if (cell.beside == 0 || edge->near_target < 0 || edge->far_target < 0) continue;
      const auto there_mm = [&](int target) {
        const Sight on = scene.look_at(target, group.stage_rad, cell.beam_rad, effect);
        Circumstances at = cell.at;
        if (on.target >= 0) {
          scene.describe(on, edges, at);
          at.target = reduced.same_as[static_cast<std::size_t>(on.target)];
        }
        return on.range_mm + effect_there(reduced, at_work, at).range_mm;
      };
      const std::span samples(reduced.beside.data() + cell.first_beside,
                              static_cast<std::size_t>(cell.beside));
      share_out(samples, there_mm(edge->near_target), there_mm(edge->far_target), group.sigma_mm, cell);
      cell.between = static_cast<int>(
          std::lround(1.0 * cell.between * (cell.n + cell.stray) / static_cast<double>(cell.beside)));
    }
  }
}

}  // namespace fit::explain::reduction
