// SPDX-License-Identifier: MIT
#include <algorithm>

#include "fit/explain/reduce.hpp"

namespace fit::explain {

std::size_t Reduced::smooth_cells() const {
  return static_cast<std::size_t>(std::ranges::count_if(cells, &Cell::smooth));
}

Scene Reduced::scene_of(const Group& group, const Nuisance& nuisance) const {
  return {bench, nuisance, capture_of(group), absent[static_cast<std::size_t>(group.capture)]};
}

double value_of(Coordinate coordinate, const Cell& cell, const Group& group) {
  switch (coordinate) {
    case Coordinate::beam:
      return cell.beam_rad * deg_per_rad;
    case Coordinate::stage:
      return group.stage_rad * deg_per_rad;
    case Coordinate::range:
      return cell.at.range_mm;
    case Coordinate::intensity:
      return cell.at.intensity;
    case Coordinate::incidence:
      return cell.at.incidence_rad * deg_per_rad;
    case Coordinate::edge_distance:
      return cell.at.edge_rad * deg_per_rad;
    case Coordinate::time:
      return group.time_s;
    case Coordinate::temperature:
      return cell.at.temperature_k;
    case Coordinate::approach:
      return cell.at.approach;
    case Coordinate::stage_rate:
      return cell.at.stage_rate_rad_s * deg_per_rad;
    case Coordinate::range_rate:
      return cell.sight.beam_lever();
    case Coordinate::scan_seq:
      return cell.at.seq;
    case Coordinate::target:
      return cell.at.target;
  }
  return 0;
}

}  // namespace fit::explain
