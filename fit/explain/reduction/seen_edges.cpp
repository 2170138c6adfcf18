// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/seen_edges.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "fit/explain/reduction/effect_there.hpp"

namespace fit::explain {
namespace {

/// Beams at the same place are one: an edge seen from many stage angles has thousands.
std::vector<Beside> places_of(const std::vector<Beside>& beams) {
  constexpr double apart_deg = 0.01;
  std::map<long, Beside> places;
  for (const Beside& b : beams) {
    if (std::abs(b.inside_deg) > edge_reach_deg + 1) continue;
    Beside& place = places[std::lround(b.inside_deg / apart_deg)];
    place.inside_deg += b.n * b.inside_deg;
    place.far_share += b.n * b.far_share;
    place.n += b.n;
  }
  std::vector<Beside> list;
  for (const auto& [at, sum] : places) list.push_back({sum.inside_deg / sum.n, sum.far_share / sum.n, sum.n});
  return list;
}

void place(SeenEdge& edge) {
  constexpr double hardly = 0.5;
  const auto [low, high] = std::ranges::minmax_element(edge.beams, {}, &Beside::far_share);
  if (edge.beams.size() < 4 || low->far_share > 0.1 || high->far_share < 0.9) return;
  const std::vector<Beside> beams = places_of(edge.beams);
  double best = -1e300;
  for (const double width_deg : {0.01, 0.03, 0.06, 0.12, 0.25}) {
    const PlaceOfEdge there = place_of_edge(beams, width_deg, 0);
    if (there.log_likelihood <= best + hardly) continue;
    best = there.log_likelihood;
    edge.shift_deg = there.shift_deg;
  }
  edge.settled = std::abs(edge.shift_deg) < edge_reach_deg - 0.05;
}

}  // namespace

double likelihood_of_edge(const std::vector<Beside>& beams, double shift_deg, double width_deg) {
  // Single samples may lie anywhere: no share is less than that, and beams farther off have it or all but it.
  constexpr double least = 0.004, all_widths = 2.66;
  static const double log_least = std::log(least), log_most = std::log(1 - least);
  double sum = 0;
  for (const Beside& b : beams) {
    const double widths = (b.inside_deg - shift_deg) / width_deg;
    double log_far = widths > 0 ? log_least : log_most, log_near = widths > 0 ? log_most : log_least;
    if (std::abs(widths) < all_widths) {
      const double far = std::clamp(0.5 * std::erfc(widths / std::sqrt(2.0)), least, 1 - least);
      log_far = std::log(far);
      log_near = std::log(1 - far);
    }
    sum += b.n * (b.far_share * log_far + (1 - b.far_share) * log_near);
  }
  return sum;
}

PlaceOfEdge place_of_edge(const std::vector<Beside>& beams, double width_deg, double about_deg) {
  constexpr double as_likely = 0.5;
  const double step = std::clamp(width_deg / 3, 0.005, 0.05);  // peaks are about as wide as the beam
  PlaceOfEdge best;
  double first = about_deg - edge_reach_deg, last = about_deg + edge_reach_deg;
  const auto look = [&](double by) {
    std::vector<PlaceOfEdge> places;
    for (double shift = first; shift <= last; shift += by)
      places.push_back({shift, likelihood_of_edge(beams, shift, width_deg)});
    const auto most = std::ranges::max_element(places, {}, &PlaceOfEdge::log_likelihood);
    best = *most;
    const auto is_likely = [&](const PlaceOfEdge& p) {
      return p.log_likelihood > best.log_likelihood - as_likely;
    };
    last = std::prev(std::find_if_not(most, places.end(), is_likely))->shift_deg;
    first = std::find_if_not(std::make_reverse_iterator(most), places.rend(), is_likely).base()->shift_deg;
  };
  const double coarse = 3 * step;
  look(coarse);
  first -= coarse;
  last += coarse;
  look(step);
  best.shift_deg = (first + last) / 2;
  return best;
}

std::map<int, SeenEdge> seen_edges(const Reduced& reduced, const Nuisance& fitted,
                                   const std::vector<Active>& at_work) {
  const Nuisance nuisance = displaced(reduced, fitted, at_work);
  std::map<int, SeenEdge> edges;
  for (const Group& group : reduced.groups) {
    const CaptureInfo& info = reduced.capture_of(group);
    if (is_turning(info)) continue;
    const Scene scene = reduced.scene_of(group, nuisance);
    const std::vector<Edge> in_sight = reduction::edges_there(reduced, group, scene, at_work);
    for (const Cell& cell : reduced.cells_of(group)) {
      if (cell.far_share < 0 || cell.edge < 0 || cell.n + cell.stray < 2) continue;
      const Target& target = reduced.bench.target_at(cell.edge / 2);
      if (info.target && *info.target == target.name && info.target_shift_mm != 0) continue;
      const auto edge = std::ranges::find(in_sight, cell.edge, &Edge::id);
      if (edge == in_sight.end() || edge->far_mm <= 0) continue;
      const Effect effect = reduction::effect_there(reduced, at_work, cell.at);
      const Sight sight = scene.look(group.stage_rad, cell.beam_rad, effect);
      const double inside = wrap_angle(sight.bearing_rad - edge->bearing_rad) * edge->near_side;
      SeenEdge& seen = edges[cell.edge];
      seen.gap_mm = edge->far_mm - edge->near_mm;
      seen.from = sight.origin;
      seen.bearing_rad = edge->bearing_rad;
      seen.near_side = edge->near_side;
      Beside beside;
      beside.inside_deg = inside * deg_per_rad;
      beside.far_share = cell.far_share;
      beside.n = std::min(20.0, 1.0 * cell.n + cell.stray);
      beside.between = cell.between * 2 > cell.n + cell.stray;
      beside.place = cell.far_share;
      const double to_behind_rad = wrap_angle(edge->bearing_rad - 0.02 * edge->near_side - sight.bearing_rad);
      const Sight behind = scene.look(group.stage_rad, cell.beam_rad + to_behind_rad, effect);
      if (cell.stray == 0 && behind.target >= 0 && behind.target != cell.edge / 2) {
        const double near = scene.look_at(cell.edge / 2, group.stage_rad, cell.beam_rad, effect).range_mm,
                     far = scene.look_at(behind.target, group.stage_rad, cell.beam_rad, effect).range_mm;
        const double gap_mm = std::max(1.0, far - near);
        beside.place = (cell.mean_mm - effect.range_mm - near) / gap_mm;
        beside.u_place =
            std::max(group.sigma_mm, std::sqrt(cell.variance_mm2)) / std::sqrt(1.0 * cell.n) / gap_mm;
      }
      seen.beams.push_back(beside);
    }
  }
  for (auto& [id, edge] : edges) place(edge);
  return edges;
}

}  // namespace fit::explain
