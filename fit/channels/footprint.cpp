// SPDX-License-Identifier: MIT
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "fit/explain/model/transitions.hpp"
#include "fit/straight_line.hpp"

namespace fit::explain::channels {
namespace {

using model::Transition;

/// Nearer, and the light of both is one echo.
constexpr double apart_mm = 500;
constexpr double reach_deg = 1.2;       ///< Farther away a beam meets one surface alone.
constexpr double surface_doubt = 0.03;  ///< By which a surface's echo changes within so few degrees.
constexpr double least_dip = 0.1;
/// A dark rim, a frame: an edge whose light is another's doing, and so is a single beam's.
constexpr double odd_edge = 0.1, odd_beam = 0.02, odd_size = 0.7;
/// Counts are a power of the echo; receivers compress.
constexpr std::array powers{1.0, 0.7, 0.4};

/// A beam beside an edge: how much of its light is missing.
struct Dimmed {
  double inside_deg = 0;  ///< From where surfaces change; positive on the nearer one.
  int side = 1;           ///< +1: it met the nearer one.
  double log_share = 0, u = 0;
  double by_geometry = 0;  ///< What of it incidence and range make.
  double odd = 0;          ///< Its likelihood where something else dims the beam.

  [[nodiscard]] bool is_dip(double log) const { return log < -std::max(least_dip, 5 * u); }
};

double normal(double off, double sigma) {
  return std::exp(-0.5 * std::pow(off / sigma, 2)) / (std::sqrt(2 * pi) * sigma);
}

/// A line, of too few points without a slope.
double level_at(const StraightLine& line, double x) {
  constexpr double enough_for_a_slope = 4;
  return line.points() < enough_for_a_slope ? line.mean() : line.at(x);
}

/// Beams of one side, against the line through those that meet this surface alone.
void add_side(const Transition& edge, int side, std::vector<Dimmed>& list) {
  constexpr double lambert_doubt = 0.3;  // of what incidence and range make
  const double change = edge.crossing_deg();
  std::vector<const Beside*> beams;
  StraightLine usual, by_law;  // log counts along the angle
  for (const Beside& b : edge.beams()) {
    const double inside = b.inside_deg - change;
    if (b.counts <= 0 || inside * side < 0 || (side > 0 ? b.far_share > 0 : b.far_share < 1)) continue;
    if (std::abs(inside) < reach_deg) {
      beams.push_back(&b);
      continue;
    }
    usual.add(inside, std::log(b.counts));
    by_law.add(inside, b.log_echo);
  }
  if (usual.points() < 2) return;
  for (const Beside* b : beams) {
    const double inside = b->inside_deg - change, geometry = b->log_echo - level_at(by_law, inside);
    const double log_share = std::log(b->counts) - level_at(usual, inside);
    list.push_back({inside, side, log_share,
                    std::hypot(surface_doubt, b->u_counts / b->counts, lambert_doubt * geometry), geometry,
                    normal(log_share, odd_size)});
  }
}

std::vector<Dimmed> dimmed_beams(const Transition& edge) {
  std::vector<Dimmed> list;
  if (edge.at().gap_mm < apart_mm) return list;
  for (const int side : {-1, 1}) add_side(edge, side, list);
  if (std::ranges::none_of(
          list, [](const Dimmed& b) { return b.is_dip(b.log_share - std::min(0.0, b.by_geometry)); }))
    list.clear();
  return list;
}

/// Where surfaces may change, close enough for beams that wide, with the weight of each place.
std::vector<std::pair<double, double>> places_of(const std::vector<Dimmed>& beams, double width_deg) {
  constexpr double widths = 2.7;
  constexpr int points = 5;
  double before = -reach_deg, behind = reach_deg;  // beams between which surfaces change
  for (const Dimmed& b : beams) {
    if (b.side < 0) before = std::max(before, b.inside_deg);
    if (b.side > 0) behind = std::min(behind, b.inside_deg);
  }
  const double from = before - widths * width_deg, to = behind + widths * width_deg;
  std::vector<double> places{from, to};
  for (const Dimmed& b : beams)
    for (int i = -points; i <= points; ++i) {
      const double place = b.inside_deg + i * widths / points * width_deg;
      if (place > from && place < to) places.push_back(place);
    }
  std::ranges::sort(places);
  std::vector<std::pair<double, double>> weighted;
  for (std::size_t k = 0; k < places.size(); ++k) {
    const double left = k == 0 ? places[k] : places[k - 1],
                 right = k + 1 == places.size() ? places[k] : places[k + 1];
    weighted.emplace_back(places[k], (right - left) / 2);
  }
  return weighted;
}

double likelihood_of(const Dimmed& b, double log_light, double power) {
  const double log = power * (log_light + b.by_geometry);
  return (1 - odd_beam) * normal(b.log_share - log, b.u) + odd_beam * b.odd;
}

/// Likelihood of an edge past which stray light of the nearer surface is an echo by itself: a small share of
/// the light, which falls to a half within a degree, and says nothing of the beam's width.
double likelihood_of_halo(const std::vector<Dimmed>& beams) {
  constexpr std::array leaks{0.003, 0.01, 0.03, 0.1};
  constexpr std::array compressions{1.0, 0.8, 0.65, 0.5, 0.4};
  constexpr double farthest_deg = 2 * reach_deg, step_deg = 0.1;
  double sum = 0;
  int all = 0;
  std::vector<double> log_light(beams.size());
  for (const double half_rad : halos_rad) {
    const double sigma_deg = half_rad * deg_per_rad / std::sqrt(2 * std::log(2.0));
    for (double place = -farthest_deg; place <= farthest_deg; place += step_deg) {
      for (std::size_t i = 0; i < beams.size(); ++i) {
        const double past = place - beams[i].inside_deg;
        log_light[i] =
            beams[i].side < 0 || past < 0 ? 0 : std::log(std::erfc(past / sigma_deg / std::sqrt(2.0)));
      }
      for (const double leak : leaks)
        for (const double power : compressions) {
          double likelihood = 1;
          for (std::size_t i = 0; i < beams.size(); ++i)
            likelihood *=
                likelihood_of(beams[i], log_light[i] < 0 ? std::log(leak) + log_light[i] : 0, power);
          sum += likelihood;
          ++all;
        }
    }
  }
  return sum / all;
}

/// Likelihood of an edge whose light is another's doing.
double likelihood_of_odd(const std::vector<Dimmed>& beams) {
  double independent = 1;
  for (const Dimmed& b : beams) independent *= b.odd;
  return (independent + likelihood_of_halo(beams)) / 2;
}

/// Log-likelihood of a beam that wide, given that a dip shows, the edge's place integrated over.
double log_likelihood(const std::vector<Dimmed>& beams, double of_odd, double width_deg) {
  constexpr double least_share = 0.02;
  double sum = 0, shown = 0;
  for (const auto& [place, weight] : places_of(beams, width_deg))
    for (const double power : powers) {
      double likelihood = weight;
      bool shows = false;
      for (const Dimmed& b : beams) {
        const double share = 0.5 * std::erfc(-b.side * (b.inside_deg - place) / width_deg / std::sqrt(2.0)),
                     light = std::log(std::max(least_share, share));
        shows = shows || b.is_dip(power * light);
        likelihood *= likelihood_of(b, light, power);
      }
      if (!shows) continue;
      shown += weight;
      sum += likelihood;
    }
  return std::log(odd_edge * of_odd + (shown > 0 ? (1 - odd_edge) * sum / shown : 0));
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
    constexpr std::size_t most_rows = 60;  // computing time
    std::vector<std::pair<Transition, std::vector<Dimmed>>> shown;
    for (Transition& edge : model::transitions(reduced))
      if (std::vector<Dimmed> beams = dimmed_beams(edge); !beams.empty())
        shown.emplace_back(std::move(edge), std::move(beams));
    std::vector<model::WidthRow> rows;
    const std::size_t every = shown.size() / most_rows + 1;
    for (std::size_t i = 0; i < shown.size(); i += every) {
      // Named, as clang 14 takes no structured binding into a lambda.
      const std::vector<Dimmed>& beams = shown[i].second;
      const Transition& edge = shown[i].first;
      const double of_odd = likelihood_of_odd(beams);
      rows.push_back({edge.at(), edge.capture(), model::WidthLikelihood([&](double width_deg) {
                        return log_likelihood(beams, of_odd, width_deg);
                      })});
    }
    if (rows.empty()) return nullptr;
    return std::make_unique<Footprints>(std::move(rows));
  };
  return kind;
}

}  // namespace fit::explain::channels
