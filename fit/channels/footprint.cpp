// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <limits>
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
/// What one surface shows away from the edge, along the angle from it: logarithms of counts, and of what
/// geometry makes of them.
struct Usual {
  bool beyond_light = true;  ///< Farther than a beam reaches: else light may be missing as well, by a slope.
  StraightLine counts, by_law;

  [[nodiscard]] double counts_at(double inside_deg) const { return level_at(counts, inside_deg); }
  [[nodiscard]] double law_at(double inside_deg) const { return level_at(by_law, inside_deg); }
  /// Of an edge that is there.
  [[nodiscard]] double read_at_deg(int side, double edge_deg) const {
    constexpr double far_away = 180;
    return beyond_light ? side * far_away : counts.middle() + edge_deg;
  }

 private:
  /// A line, of too few points, of one place or of places that are not far enough without a slope.
  [[nodiscard]] double level_at(const StraightLine& line, double x) const {
    constexpr double enough_for_a_slope = 4, one_place_deg2 = 1e-6;
    return !beyond_light || line.points() < enough_for_a_slope || line.spread() < one_place_deg2 ? line.mean()
                                                                                                 : line.at(x);
  }
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

/// Calls for every beam of one side whose samples all met the surface that ends there, or stands behind it;
/// by the bench file's place of the edge it may meet the other one.
template <class Call>
void of_side(const Transition& edge, int side, const Call& call) {
  const double change = edge.crossing_deg();
  const int target = target_beside(edge, side), other = target_beside(edge, -side);
  for (const Beside& b : edge.beams) {
    const double inside = b.inside_deg - change;
    const bool is_other_by_bench = b.target == other && b.inside_deg * side < 0;
    if (b.counts > 0 && (b.target == target || is_other_by_bench) && inside * side > 0 &&
        (side > 0 ? b.far_share <= 0 : b.far_share >= 1))
      call(b, inside, is_other_by_bench);
  }
}

void add_usual(const Transition& edge, int side, double from_deg, Usual& usual) {
  of_side(edge, side, [&](const Beside& b, double inside, bool is_other_by_bench) {
    if (std::abs(inside) < from_deg || is_other_by_bench) return;
    usual.counts.add(inside, std::log(b.counts));
    usual.by_law.add(inside, b.log_echo);
  });
}

constexpr double fewest = 2;

/// From where on one side of an edge shows what its surface usually returns: beyond the reach of light, or
/// else where the farthest beams are, as far as that is one place.
double usual_from_deg(const EdgeInCaptures& edge, int side) {
  constexpr double one_place_deg = 0.1;
  double farthest = 0, beyond = 0;
  for (const Transition& capture : edge.captures)
    of_side(capture, side, [&](const Beside&, double inside, bool is_other_by_bench) {
      farthest = std::max(farthest, std::abs(inside));
      if (std::abs(inside) >= model::light_reach_deg && !is_other_by_bench) beyond += 1;
    });
  return beyond < fewest ? std::max(0.0, farthest - one_place_deg) : model::light_reach_deg;
}

/// What one side of an edge shows away from it.
struct UsualOfSide {
  double from_deg = 0;
  std::vector<Usual> of_captures;
  Usual in_all;
  double u_of_capture = 0;  ///< By which captures' levels differ: other beams see the edge in each of them.
};

UsualOfSide usual_of(const EdgeInCaptures& edge, int side) {
  UsualOfSide usual;
  usual.from_deg = usual_from_deg(edge, side);
  const Usual nothing_yet{
      .beyond_light = usual.from_deg >= model::light_reach_deg, .counts = {}, .by_law = {}};
  usual.in_all = nothing_yet;
  for (const Transition& capture : edge.captures) {
    usual.of_captures.push_back(nothing_yet);
    add_usual(capture, side, usual.from_deg, usual.of_captures.back());
    add_usual(capture, side, usual.from_deg, usual.in_all);
  }
  double levels = 0, squares = 0;
  for (const Usual& own : usual.of_captures) {
    if (own.counts.points() == 0) continue;
    levels += 1;
    squares += std::pow(own.counts.mean() - usual.in_all.counts_at(own.counts.middle()), 2);
  }
  usual.u_of_capture =
      levels > 1 ? std::sqrt(squares / (levels - 1)) : std::numeric_limits<double>::infinity();
  return usual;
}

/// Beams close to the edge, against what their surface usually shows: in this capture, or else in all of
/// them.
void set_beams(EdgeInCaptures& edge) {
  constexpr double u_lambert = 0.3;  // of what incidence and range make
  edge.beams.resize(edge.captures.size());
  std::map<int, UsualOfSide> sides;
  for (const int side : {-1, 1}) sides[side] = usual_of(edge, side);
  for (const int side : {-1, 1}) {
    const UsualOfSide& here = sides[side];
    if (here.in_all.counts.points() < fewest) continue;
    const bool both = sides[-side].in_all.counts.points() >= fewest;
    for (std::size_t k = 0; k < edge.captures.size(); ++k) {
      const Usual& own = here.of_captures[k];
      const bool knows_own = own.counts.points() >= fewest;
      if (!knows_own && !std::isfinite(here.u_of_capture)) continue;
      const Usual& usual = knows_own ? own : here.in_all;
      const double u_level = knows_own ? 0 : here.u_of_capture,
                   other = both ? sides[-side].in_all.counts_at(0) - usual.counts_at(0) : 0;
      of_side(edge.captures[k], side, [&](const Beside& b, double inside, bool is_other_by_bench) {
        if (std::abs(inside) >= here.from_deg) return;
        const double geometry = is_other_by_bench ? 0 : b.log_echo - usual.law_at(inside),
                     log_share = std::log(b.counts) - usual.counts_at(inside),
                     u = std::hypot(std::hypot(u_surface, u_level), b.u_counts / b.counts,
                                    u_lambert * geometry);
        edge.beams[k].push_back({b.inside_deg, side, log_share, u,
                                 usual.read_at_deg(side, edge.captures[k].crossing_deg()), geometry, other});
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
