// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/effect_there.hpp"
#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain {

using reduction::effect_there;

Effect reduction::effect_there(const Reduced& reduced, const std::vector<Active>& at_work,
                               const Circumstances& at) {
  Effect effect = effect_of(at_work, at);
  effect.range_mm += reduced.output_steps.bias_mm(at.range_mm + effect.range_mm);
  return effect;
}

std::vector<Edge> reduction::edges_there(const Reduced& reduced, const Group& group, const Scene& scene,
                                         const std::vector<Active>& at_work) {
  if (group.first_cell == group.last_cell) return {};
  // Where the lidar is does not depend on the beam.
  const Cell& any = reduced.cells[(group.first_cell + group.last_cell) / 2];
  return scene.edges(group.stage_rad, effect_there(reduced, at_work, any.at));
}

Nuisance displaced(const Reduced& reduced, Nuisance nuisance, const std::vector<Active>& at_work) {
  for (const Active& active : at_work) {
    if (!active.mechanism->displaces || active.target < 0) continue;
    const Displacement moved = active.mechanism->displaces(active.values);
    for (std::size_t i = 0; i < nuisance.targets.size(); ++i)
      if (reduced.same_as[i] == active.target) nuisance.targets[i] += moved;
  }
  return nuisance;
}

void predict(Reduced& reduced, const Nuisance& fitted, const std::vector<Active>& at_work,
             bool may_leave_out) {
  const Nuisance nuisance = displaced(reduced, fitted, at_work);
  for (const Group& group : reduced.groups) {
    const Scene scene = reduced.scene_of(group, nuisance);
    for (Cell& cell : reduced.cells_of(group)) {
      if (!cell.usable) continue;
      const Effect effect = effect_there(reduced, at_work, cell.at);
      const Sight sight = may_leave_out
                              ? scene.look(group.stage_rad, cell.beam_rad, effect)
                              : scene.look_at(cell.sight.target, group.stage_rad, cell.beam_rad, effect);
      if (sight.target != cell.sight.target) {
        if (!may_leave_out) continue;
        cell.usable = false;
        ++reduced.left_out;
        continue;
      }
      cell.sight = sight;
      scene.describe_place(sight.bearing_rad, sight, cell.at);
      // Once more: mount and walls may have moved since the circumstances before.
      cell.nominal_mm = sight.range_mm + effect_there(reduced, at_work, cell.at).range_mm + cell.of_scans_mm;
    }
  }
}

}  // namespace fit::explain
