// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "fit/explain/reduction/effect_there.hpp"
#include "fit/explain/reduction/margins.hpp"
#include "fit/explain/reduction/reduce.hpp"
#include "fit/explain/reduction/seen_edges.hpp"

namespace fit::explain {
namespace {

using reduction::corner_margin_mm, reduction::place_uncertainty_mm;

/// What is left of the doubt about mount and walls once they are fitted: a share of what the priors leave.
constexpr double coverage_left = 0.15 * reduction::coverage_of_mount;

/// What a cell's beam meets now.
struct Met {
  Sight sight;
  Circumstances at;
  double effect_mm = 0;                                       ///< On the range, of mechanisms at work.
  double joint_mm = std::numeric_limits<double>::infinity();  ///< To where another target begins.
};

class Reassignment {
 public:
  Reassignment(Reduced& reduced, const Nuisance& fitted, const std::vector<Active>& at_work,
               double footprint_rad)
      : reduced_(reduced),
        at_work_(at_work),
        nuisance_(displaced(reduced, fitted, at_work)),
        seen_(seen_edges(reduced, fitted, at_work)),
        width_rad_(footprint_rad > 0 ? footprint_rad : reduction::usual_width_rad) {}

  /// Returns how many cells changed.
  int run() {
    int changed = 0;
    for (const Group& group : reduced_.groups) {
      const Scene scene = reduced_.scene_of(group, nuisance_);
      const std::vector<Edge> edges = reduction::edges_there(reduced_, group, scene, at_work_);
      for (Cell& cell : reduced_.cells_of(group)) {
        if (!cell.doubtful && !cell.usable) continue;
        const Met now = met_by(cell, group, scene, edges);
        changed += cell.usable ? leaves_out(cell, now) : takes_in(cell, now, group);
      }
    }
    return changed;
  }

 private:
  [[nodiscard]] Met met_by(const Cell& cell, const Group& group, const Scene& scene,
                           const std::vector<Edge>& edges) const {
    const Effect effect = reduction::effect_there(reduced_, at_work_, cell.at);
    Met met{.sight = scene.look(group.stage_rad, cell.beam_rad, effect),
            .at = cell.at,
            .effect_mm = effect.range_mm};
    Circumstances& at = met.at;
    at.corner_mm = at.edge_rad = std::numeric_limits<double>::infinity();
    at.gap_mm = 0;
    at.pull_mm = at.pull_apart_mm = at.pull_front_mm = at.spread_mm = {};
    const int target = met.sight.target;
    if (target >= 0) {
      scene.describe(met.sight, edges, at);
      met.joint_mm = scene.to_joint_mm(met.sight);
    }
    at.target = target < 0 ? -1 : reduced_.same_as[static_cast<std::size_t>(target)];
    return met;
  }

  /// A smooth cell that meets another target, a corner, or a surface at grazing incidence.
  bool leaves_out(Cell& cell, const Met& now) {
    constexpr double hardly_rad = 2 * rad_per_deg;  // a wall that turns by less stays
    // By geometry alone: how far a mean is off must not decide whether it counts.
    if (now.sight.target == cell.sight.target &&
        std::abs(now.sight.incidence_rad) < grazing_rad(now) + hardly_rad &&
        now.joint_mm >= corner_margin_mm(now.sight, 0, reduction::half_width_rad(cell)))
      return false;
    cell.usable = false;
    cell.doubtful = true;
    ++reduced_.left_out;
    return true;
  }

  /// A doubtful cell that is off by no more than mount and walls may be, away from corners and edges.
  bool takes_in(Cell& cell, const Met& now, const Group& group) {
    if (now.sight.target < 0 || !is_clear(now, cell)) return false;
    const double nominal = now.sight.range_mm + now.effect_mm;
    if (std::abs(cell.mean_mm - nominal) > 60 + 5 * group.sigma_mm) return false;
    cell.sight = now.sight;
    cell.at = now.at;
    cell.nominal_mm = nominal;
    cell.u_edge_mm =
        reduction::u_at_edge_mm(now.sight, from_edge(cell.edge, now.at), now.at.gap_mm, width_rad_);
    cell.usable = true;
    cell.doubtful = false;
    --reduced_.left_out;
    return true;
  }

  [[nodiscard]] double grazing_rad(const Met& now) const {
    return reduction::grazing_rad(reduced_.bench.target_at(now.sight.target));
  }

  [[nodiscard]] bool is_clear(const Met& now, const Cell& cell) const {
    const Mount& mount = reduced_.bench.lidar.mount;
    const double half_rad = reduction::half_width_rad(cell),
                 uncertainty_mm = place_uncertainty_mm(mount, now.sight.range_mm, coverage_left);
    return std::abs(now.sight.incidence_rad) < grazing_rad(now) &&
           now.joint_mm >= corner_margin_mm(now.sight, uncertainty_mm, half_rad) &&
           from_edge(cell.edge, now.at) >= half_rad + edge_margin_rad(cell.edge);
  }

  /// Where the recording shows the edge, or where it may be.
  [[nodiscard]] double edge_margin_rad(int edge) const {
    constexpr double seen_rad = 0.25 * rad_per_deg, stated_rad = 0.6 * rad_per_deg;
    const double doubt_rad =
        is_settled(edge) ? seen_rad : stated_rad + coverage_left * reduced_.bench.lidar.mount.yaw_rad.u;
    return std::max(doubt_rad, reduction::widths_of_beam * width_rad_);
  }

  [[nodiscard]] bool is_settled(int edge) const {
    const auto found = seen_.find(edge);
    return found != seen_.end() && found->second.settled;
  }

  /// Bright surfaces seem wider than they are: an edge is where the recording shows it.
  [[nodiscard]] double from_edge(int edge, const Circumstances& at) const {
    const double shift_rad = is_settled(edge) ? seen_.at(edge).shift_deg * rad_per_deg : 0;
    return std::min(std::abs(at.edge_rad), std::abs(at.edge_rad - shift_rad));
  }

  Reduced& reduced_;
  const std::vector<Active>& at_work_;
  Nuisance nuisance_;
  std::map<int, SeenEdge> seen_;
  double width_rad_;
};

}  // namespace

int reassign(Reduced& reduced, const Nuisance& fitted, const std::vector<Active>& at_work,
             double footprint_rad) {
  return Reassignment(reduced, fitted, at_work, footprint_rad).run();
}

}  // namespace fit::explain
