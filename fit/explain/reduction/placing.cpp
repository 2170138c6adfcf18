// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/placing.hpp"

#include <cmath>
#include <limits>

#include "fit/explain/reduction/margins.hpp"

namespace fit::explain::reduction {
namespace {

constexpr double edge_margin_rad = 1.3 * rad_per_deg;   // half a footprint and doubt about the yaw
constexpr double brink_margin_rad = 0.8 * rad_per_deg;  // where nothing lies behind the edge: only the yaw

Circumstances circumstances(const Reduced& session, const Setting& setting, const Cell& cell, double beam_s) {
  const auto& [capture, group, samples, scene, edges] = setting;
  constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
  Circumstances c;
  scene.describe(cell.sight, edges, c);
  c.target = session.same_as[static_cast<std::size_t>(cell.sight.target)];
  c.beam_rad = cell.beam_rad;
  c.stage_rad = group.stage_rad;
  c.time_s = group.time_s;
  c.clock_s = group.clock_s;
  c.temperature_k =
      capture.temperature_c ? *capture.temperature_c - session.reference_temperature_c : unknown;
  c.beam_time_s = beam_s;
  c.since_move_s = samples.since_start_s.front() + c.beam_time_s;
  c.stage_rate_rad_s = capture.stage_rate_rad_s;
  c.approach = capture.approach;
  c.seq = static_cast<int>(samples.seq.front());
  c.intensity = unknown;
  return c;
}

/// Whether the mean may be compared with a surface, or only may not because of what is doubtful.
void judge_place(const Bench& bench, const Setting& setting, const Beams& beams, Cell& cell) {
  const Mount& mount = bench.lidar.mount;
  const Samples& samples = setting.samples;
  const Circumstances& c = cell.at;
  const double half_rad = half_width_rad(cell),
               uncertainty_mm = place_uncertainty_mm(mount, cell.sight.range_mm, coverage_of_mount);
  const bool near_corner =
      setting.scene.to_joint_mm(cell.sight) < corner_margin_mm(cell.sight, uncertainty_mm, half_rad);
  const double half_column_rad = samples.grid ? samples.grid->spacing_rad() / 2 : 0,
               from_edge = std::abs(c.edge_rad) - half_column_rad - half_rad;
  const bool near_edge = from_edge <= (c.gap_mm > 0 ? edge_margin_rad : brink_margin_rad);
  const bool slanted = std::abs(cell.sight.incidence_rad) >= grazing_rad(bench.target_at(cell.sight.target));
  cell.usable = !near_edge && !near_corner && !slanted;
  cell.doubtful = !cell.usable && !slanted && beams.count == 1;
  cell.u_edge_mm = u_at_edge_mm(cell.sight, from_edge, c.gap_mm, usual_width_rad);
  // What passes an edge with nothing behind gives no echo. Before another surface a part of the spot weakens
  // the echo, and a weak echo reads otherwise: such a beam tells of edges, and its mean of no range.
  const bool is_of_edge = from_edge > beside_rad && c.gap_mm == 0;
  if (cell.doubtful && near_edge && !near_corner && is_of_edge) cell.usable = true;
}

/// The edge within reach, and the surface on its other side.
void find_edge(const Bench& bench, const Setting& setting, Cell& cell) {
  const Edge* nearest = nearest_edge(setting.edges, cell.sight.bearing_rad);
  if (!nearest) return;
  cell.edge = nearest->id;
  if (!(std::abs(cell.at.edge_rad) < edge_window_rad) || !(cell.at.gap_mm > 0)) return;
  // Both surfaces may be slanted: each is taken where this beam would meet it.
  const bool on_near = cell.at.edge_rad > 0;
  if (cell.sight.target != (on_near ? nearest->near_target : nearest->far_target)) return;
  const int other = on_near ? nearest->far_target : nearest->near_target;
  if (other < 0) return;
  const Sight there = setting.scene.look_at(other, setting.group.stage_rad, cell.beam_rad, {});
  cell.other_mm = there.range_mm;
  if (there.target == other)
    cell.misplaced_mm = std::max(misplaced_mm(bench, cell.sight), misplaced_mm(bench, there));
}

}  // namespace

Cell placed(const Reduced& session, const Setting& setting, const Beams& beams) {
  Cell cell;
  cell.beam_rad = beams.midway(setting.samples.beam_rad);
  cell.sight = setting.scene.look(setting.group.stage_rad, cell.beam_rad);
  if (cell.sight.target < 0) return cell;
  cell.at = circumstances(session, setting, cell, beams.midway(setting.samples.beam_s));
  cell.nominal_mm = cell.sight.range_mm;
  if (beams.count > 1) {
    cell.joined_rad = beams.spread(setting.samples.beam_rad);
    cell.joined_sensitivity_mm = cell.sight.beam_sensitivity();
  }
  judge_place(session.bench, setting, beams, cell);
  find_edge(session.bench, setting, cell);
  return cell;
}

}  // namespace fit::explain::reduction
