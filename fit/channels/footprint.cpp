// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "fit/explain/model/edge_light.hpp"
#include "fit/explain/model/transitions.hpp"
#include "fit/numeric/straight_line.hpp"

namespace fit::explain::channels {
namespace {

using model::Dimmed;
using model::Dimming;
using model::Transition;

/// Nearer, and the light of both is one echo.
constexpr double apart_mm = 500;
constexpr double u_surface = 0.03;  ///< By which a surface's echo changes within so few degrees.
/// A line, of too few points or of one place without a slope.
double level_at(const StraightLine& line, double x) {
  constexpr double enough_for_a_slope = 4, one_place_deg2 = 1e-6;
  return line.points() < enough_for_a_slope || line.spread() < one_place_deg2 ? line.mean() : line.at(x);
}

/// What one surface shows farther from the edge than a beam reaches, along the angle from the edge:
/// logarithms of counts, and of what geometry makes of them.
struct Usual {
  StraightLine counts, by_law;
};

/// One edge while its target stands, in the captures that show it.
struct EdgeInCaptures {
  std::vector<Transition> captures;
  std::vector<Dimming> beams;
};

/// The target that most beams meet so close to an edge, on one side of it; -1: there are none.
int target_beside(const Transition& edge, int side) {
  std::map<int, int> beams;
  for (const Beside& b : edge.beams)
    if (const double inside = side * (b.inside_deg - edge.crossing_deg());
        inside > 0 && inside < model::light_reach_deg)
      ++beams[b.target];
  const auto most = std::ranges::max_element(beams, {}, [](const auto& one) { return one.second; });
  return most == beams.end() ? -1 : most->first;
}

/// Calls for every beam of one side whose samples all met the surface that ends there, or stands behind it.
template <class Call>
void of_side(const Transition& edge, int side, const Call& call) {
  const double change = edge.crossing_deg();
  const int target = target_beside(edge, side);
  for (const Beside& b : edge.beams) {
    const double inside = b.inside_deg - change;
    if (b.counts > 0 && b.target == target && inside * side > 0 &&
        (side > 0 ? b.far_share <= 0 : b.far_share >= 1))
      call(b, inside);
  }
}

void add_usual(const Transition& edge, int side, Usual& usual) {
  of_side(edge, side, [&](const Beside& b, double inside) {
    if (std::abs(inside) < model::light_reach_deg) return;
    usual.counts.add(inside, std::log(b.counts));
    usual.by_law.add(inside, b.log_echo);
  });
}

/// Beams close to the edge, against what their surface usually shows: in this capture, or else in all of
/// them.
void set_beams(EdgeInCaptures& edge) {
  constexpr double u_lambert = 0.3;  // of what incidence and range make
  constexpr double fewest = 2;
  edge.beams.resize(edge.captures.size());
  std::map<int, Usual> in_all;
  for (const int side : {-1, 1})
    for (const Transition& capture : edge.captures) add_usual(capture, side, in_all[side]);
  for (const int side : {-1, 1}) {
    if (in_all[side].counts.points() < fewest) continue;
    const bool both = in_all[-side].counts.points() >= fewest;
    for (std::size_t k = 0; k < edge.captures.size(); ++k) {
      Usual own;
      add_usual(edge.captures[k], side, own);
      const Usual& usual = own.counts.points() < fewest ? in_all[side] : own;
      const double other = both ? level_at(in_all[-side].counts, 0) - level_at(usual.counts, 0) : 0;
      of_side(edge.captures[k], side, [&](const Beside& b, double inside) {
        if (std::abs(inside) >= model::light_reach_deg) return;
        const double geometry = b.log_echo - level_at(usual.by_law, inside),
                     log_share = std::log(b.counts) - level_at(usual.counts, inside);
        edge.beams[k].push_back({b.inside_deg, side, log_share,
                                 std::hypot(u_surface, b.u_counts / b.counts, u_lambert * geometry), geometry,
                                 other});
      });
    }
  }
}

bool shows_dip(const std::vector<Dimmed>& list) {
  return std::ranges::any_of(
      list, [](const Dimmed& b) { return b.is_dip(b.log_share - std::min(0.0, b.by_geometry)); });
}

/// Light that is missing beside an edge, where any is: the rest of the beam went past, to the surface behind.
/// An angle that is drawn anew takes no light away. Receivers whose intensity is no measure of it show
/// nothing, and that says nothing.
class Footprints final : public model::WidthRows {
 public:
  explicit Footprints(std::vector<model::WidthRow> rows) : WidthRows(std::move(rows)) {}
  [[nodiscard]] double response(Eigen::Index, const Effect& effect) const override {
    return effect.light_rad * effect.light_rad * deg_per_rad * deg_per_rad;
  }
};

/// The light of a round post falls by itself towards its sides, more steeply the nearer, and by how much
/// hangs on hundredths of a degree.
bool is_round(const Bench& bench, int target) {
  return target >= 0 && bench.target_at(target).round.has_value();
}

/// From the first capture on that shows a dip: receivers whose intensity is no measure of it show none.
std::vector<EdgeInCaptures> edges_of(const Reduced& reduced) {
  constexpr std::size_t most_rows = 60;  // computing time
  std::map<model::PlacedEdge, EdgeInCaptures> by_edge;
  for (Transition& seen : model::transitions(reduced)) {
    if (seen.at.gap_mm < apart_mm || is_round(reduced.bench, target_beside(seen, 1))) continue;
    by_edge[model::placed(reduced, seen)].captures.push_back(std::move(seen));
  }
  std::size_t all = 0;
  std::vector<EdgeInCaptures> edges;
  for (auto& [key, edge] : by_edge) {
    set_beams(edge);
    EdgeInCaptures& shown = edges.emplace_back();
    for (std::size_t k = 0; k < edge.captures.size(); ++k) {
      if (edge.beams[k].empty() || (shown.beams.empty() && !shows_dip(edge.beams[k]))) continue;
      shown.captures.push_back(std::move(edge.captures[k]));
      shown.beams.push_back(std::move(edge.beams[k]));
    }
    all += shown.beams.size();
    if (shown.beams.empty()) edges.pop_back();
  }
  const std::size_t every = all / most_rows + 1;
  for (EdgeInCaptures& edge : edges)
    for (std::size_t k = edge.beams.size(); k-- > 0;)
      if (k % every != 0) {
        edge.captures.erase(edge.captures.begin() + static_cast<std::ptrdiff_t>(k));
        edge.beams.erase(edge.beams.begin() + static_cast<std::ptrdiff_t>(k));
      }
  return edges;
}

void add_rows(const EdgeInCaptures& edge, std::vector<model::WidthRow>& rows) {
  const model::EdgeLight light(edge.beams);
  auto widths =
      model::in_turn(edge.beams.size(), [&](double width_deg) { return light.log_likelihoods(width_deg); });
  for (std::size_t k = 0; k < widths.size(); ++k)
    rows.push_back({edge.captures[k].at, edge.captures[k].capture, std::move(widths[k])});
}

}  // namespace

model::ChannelKind make_footprint() {
  model::ChannelKind kind;
  kind.id = "footprint";
  kind.observable = Observable::intensity;
  kind.has_forms = false;
  kind.shows = "beam width by the light that is missing beside edges, where any is";
  kind.unit = "deg";
  kind.is_square = true;
  kind.rows = [](const Reduced& reduced, const MeanNoise&) -> std::unique_ptr<model::ChannelRows> {
    if (!reduced.has_intensity) return nullptr;
    std::vector<model::WidthRow> rows;
    for (const EdgeInCaptures& edge : edges_of(reduced)) add_rows(edge, rows);
    if (rows.empty()) return nullptr;
    return std::make_unique<Footprints>(std::move(rows));
  };
  return kind;
}

}  // namespace fit::explain::channels
