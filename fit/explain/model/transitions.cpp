// SPDX-License-Identifier: MIT
#include "fit/explain/model/transitions.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <utility>

#include "fit/explain/model/edge_place.hpp"
#include "fit/explain/model/stage_stops.hpp"
#include "fit/explain/reduction/margins.hpp"

namespace fit::explain::model {
namespace {

/// Where the fewest samples are of the wrong surface: mount and target may stand aside.
double crossing_deg(std::vector<Beside> beams) {
  std::ranges::sort(beams, {}, &Beside::inside_deg);
  double wrong = 0;
  for (const Beside& b : beams) wrong += b.n * b.far_share;  // were the edge before all of them
  double least = wrong, at = beams.front().inside_deg;
  for (std::size_t i = 0; i + 1 < beams.size(); ++i) {
    wrong += beams[i].n * (1 - 2 * beams[i].far_share);
    if (wrong >= least) continue;
    least = wrong;
    at = (beams[i].inside_deg + beams[i + 1].inside_deg) / 2;
  }
  return at;
}

/// Log-likelihood of beams that wide, the edge's place integrated over: by chance alone a narrow beam seldom
/// meets an edge that it sees mixed.
double integrated_over_place(const std::vector<Beside>& beams, double width_deg) {
  constexpr double widths = 2.7;              // beyond, a beam sees one surface
  constexpr int points = 8;                   // on either side of every beam
  const double middle = crossing_deg(beams);  // between two beams that may be far apart
  std::vector<double> at = {middle - edge_reach_deg, middle, middle + edge_reach_deg};
  for (const Beside& b : beams)
    for (int i = -points; i <= points; ++i) {
      const double place = b.inside_deg + i * widths / points * width_deg;
      if (std::abs(place - middle) < edge_reach_deg) at.push_back(place);
    }
  std::ranges::sort(at);
  std::vector<double> logs;
  for (const double place : at) logs.push_back(likelihood_of_edge(beams, place, width_deg));
  const double most = std::ranges::max(logs);
  double sum = 0;
  for (std::size_t i = 0; i + 1 < at.size(); ++i)
    sum += (at[i + 1] - at[i]) * (std::exp(logs[i] - most) + std::exp(logs[i + 1] - most)) / 2;
  return most + std::log(sum / (2 * edge_reach_deg));
}

/// Where hard edges or such of beams that wide may be by what one capture shows, and what a fit leaves open.
PlaceGrid places_beside(const std::vector<Beside>& beams, double width_deg) {
  constexpr double finest_deg = 0.002, steps = 3, widths = 2.7, drift_deg = 0.2;
  const double crossing = crossing_deg(beams), beyond = widths * width_deg + drift_deg;
  double before = crossing - edge_reach_deg, behind = crossing + edge_reach_deg;
  for (const Beside& b : beams) {
    if (b.inside_deg <= crossing) before = std::max(before, b.inside_deg);
    if (b.inside_deg >= crossing) behind = std::min(behind, b.inside_deg);
  }
  return {before - beyond, behind + beyond, std::max(finest_deg, width_deg / steps)};
}

/// Of an edge's captures, each given those before.
std::vector<double> log_likelihoods_in_turn(const std::vector<const Transition*>& captures,
                                            double width_deg) {
  const PlaceGrid places = places_beside(captures.front()->beams, width_deg);
  std::vector<double> here(places.count), logs;
  std::optional<EdgePlace> edge;
  for (const Transition* capture : captures) {
    const double anywhere = integrated_over_place(capture->beams, width_deg);
    for (std::size_t i = 0; i < places.count; ++i)
      here[i] = likelihood_of_edge(capture->beams, places.at(i), width_deg);
    const double most = std::max(anywhere, std::ranges::max(here));
    for (double& log : here) log = std::exp(log - most);
    logs.push_back(edge ? most + edge->next(here, std::exp(anywhere - most)) : anywhere);
    if (!edge) edge.emplace(here, places.step_deg);
  }
  return logs;
}

/// Share of the farther surface; none or all where noise and the places of both surfaces leave that open.
double share_of(const Cell& cell, double sigma_mm) {
  const double doubt = (2 * sigma_mm + std::max(8.0, 3 * cell.misplaced_mm)) / cell.at.gap_mm;
  return cell.far_share < doubt ? 0 : cell.far_share > 1 - doubt ? 1 : cell.far_share;
}

}  // namespace

WidthLikelihood Transition::width() const {
  return WidthLikelihood([this](double width_deg) { return integrated_over_place(beams, width_deg); });
}

Transition::Shared Transition::shared() const {
  constexpr double least_deg = 0.3;
  const double wide_deg2 = width().best_deg2(), edge_deg = place_deg(wide_deg2),
               reach_deg = std::max(least_deg, 3 * std::sqrt(wide_deg2));
  struct Side {
    Shared beside;         ///< Of beams that may meet both surfaces ...
    double away = 0;       ///< ... and between them, of others, ...
    bool is_seen = false;  ///< ... if there are any.
  } sides[2];
  for (const Beside& b : beams) {
    Side& side = sides[b.inside_deg > edge_deg];
    const bool is_beside = std::abs(b.inside_deg - edge_deg) < reach_deg;
    (is_beside ? side.beside.between : side.away) += b.on_neither;
    if (is_beside) side.beside.samples += b.n;
    side.is_seen = side.is_seen || !is_beside;
  }
  // Where beams that see one surface are on neither, it stands elsewhere, and nothing is between.
  Shared sum;
  for (const Side& side : sides) {
    if (!side.is_seen || side.away > 0) continue;
    sum.between += side.beside.between;
    sum.samples += side.beside.samples;
  }
  return sum;
}

double Transition::crossing_deg() const { return model::crossing_deg(beams); }

double Transition::place_deg(double variance_deg2) const {
  return place_of_edge(beams, std::sqrt(variance_deg2), crossing_deg()).shift_deg;
}

namespace {

/// Whether stage and targets stand as they did for the group before.
bool stands_as_before(const Reduced& reduced, std::size_t group) {
  if (!stands_still(reduced, group)) return false;
  const CaptureInfo &before = reduced.capture_of(reduced.groups[group - 1]),
                    &now = reduced.capture_of(reduced.groups[group]);
  return before.target == now.target && before.target_shift_mm == now.target_shift_mm;
}

/// Intensity of a beam's samples.
struct Light {
  double n = 0, counts = 0, variance = 0, log_echo = 0;
  bool is_whole = true;  ///< Every cell has one, of a surface that is sure.

  void add(const Cell& cell, const Mount& mount) {
    constexpr double grazing_rad = 70 * rad_per_deg;
    const double place_uncertainty_mm =
        reduction::place_uncertainty_mm(mount, cell.sight.range_mm, reduction::coverage_of_mount);
    is_whole = is_whole && cell.n > 1 && cell.counts > 0 &&
               std::abs(cell.sight.incidence_rad) < grazing_rad &&
               cell.at.corner_mm > reduction::corner_margin_mm(cell.sight, place_uncertainty_mm, 0);
    if (!is_whole) return;
    counts += (cell.counts - counts) * cell.n / (n + cell.n);
    log_echo += (std::log(cell.at.cos_incidence) - 2 * std::log(cell.sight.range_mm) - log_echo) * cell.n /
                (n + cell.n);
    variance += (cell.intensity_sd * cell.intensity_sd - variance) * cell.n / (n + cell.n);
    n += cell.n;
  }
  void note(Beside& beside) const {
    if (!is_whole || beside.on_neither > 0) return;
    constexpr double rounding = 1.0 / 12;
    beside.counts = counts;
    beside.log_echo = log_echo;
    beside.u_counts = std::sqrt(variance / n + rounding);
  }
};

/// Beams at the same angles, whose shares are of all their samples.
struct Beams {
  Circumstances at;
  std::map<double, Beside> list;
  std::map<double, Light> light;
  int capture = 0;
  double samples = 0, scattered_deg2 = 0;

  void add(const Cell& cell, double sigma_mm, const Mount& mount) {
    if (list.empty() || std::abs(cell.at.edge_rad) < std::abs(at.edge_rad)) at = cell.at;
    Beside& beside = list[cell.beam_rad];
    const double n = cell.n + cell.stray, all = beside.n + n;
    const auto take = [&](double& mean, double value) { mean += (value - mean) * n / all; };
    take(beside.inside_deg, cell.at.edge_rad * deg_per_rad);
    take(beside.far_share, share_of(cell, sigma_mm));
    beside.n = all;
    samples += n;
    scattered_deg2 += (cell.aside_rad2 * deg_per_rad * deg_per_rad - scattered_deg2) * n / samples;
    beside.on_neither += cell.between;
    beside.target = cell.sight.target;
    light[cell.beam_rad].add(cell, mount);
  }
  [[nodiscard]] std::vector<Beside> counted() const {
    constexpr double most_samples = 20;  // of one beam, with what its neighbours have in common
    std::vector<Beside> beams;
    for (const auto& [angle, beside] : list) {
      beams.push_back(beside);
      beams.back().n = std::min(most_samples, beside.n);
      beams.back().on_neither *= beams.back().n / beside.n;
      light.at(angle).note(beams.back());
    }
    return beams;
  }
};

}  // namespace

std::vector<Transition> transitions(const Reduced& reduced) {
  std::map<std::pair<std::size_t, int>, Beams> by_edge;  // first group of a stand, edge
  std::size_t standing = 0;
  for (std::size_t g = 0; g < reduced.groups.size(); ++g) {
    const Group& group = reduced.groups[g];
    const CaptureInfo& capture = reduced.capture_of(group);
    // Where the stage turns a cell is of several beams, of which an edge parts one from the next.
    if (is_turning(capture)) continue;
    if (!stands_as_before(reduced, g)) standing = g;
    for (const Cell& cell : reduced.cells_of(group)) {
      if (cell.far_share < 0 || cell.edge < 0 || cell.n + cell.stray < 2) continue;
      const auto [beams, is_new] = by_edge.try_emplace({standing, cell.edge});
      if (is_new) beams->second.capture = group.capture;
      beams->second.add(cell, group.sigma_mm, reduced.bench.lidar.mount);
    }
  }
  std::vector<Transition> all;
  for (const auto& [key, beams] : by_edge) {
    std::vector<Beside> list = beams.counted();
    const auto [least, most] = std::ranges::minmax(list, {}, &Beside::far_share);
    if (least.far_share < 0.5 && most.far_share > 0.5)
      all.push_back({beams.capture, key.second, beams.at, std::move(list), beams.scattered_deg2});
  }
  return all;
}

PlacedEdge placed(const Reduced& reduced, const Transition& transition) {
  const CaptureInfo& capture = reduced.captures[static_cast<std::size_t>(transition.capture)];
  return {transition.edge, capture.target, capture.target_shift_mm};
}

std::vector<WidthRow> widths_of(const Reduced& reduced, const std::vector<Transition>& all) {
  std::map<PlacedEdge, std::vector<const Transition*>> by_edge;
  for (const Transition& seen : all) by_edge[placed(reduced, seen)].push_back(&seen);
  std::map<const Transition*, WidthLikelihood> widths;
  for (const auto& [key, captures] : by_edge) {
    std::vector<WidthLikelihood> each = in_turn(
        captures.size(), [&](double width_deg) { return log_likelihoods_in_turn(captures, width_deg); });
    for (std::size_t k = 0; k < captures.size(); ++k) widths.emplace(captures[k], std::move(each[k]));
  }
  std::vector<WidthRow> rows;
  for (const Transition& seen : all) rows.push_back({seen.at, seen.capture, std::move(widths.at(&seen))});
  return rows;
}

SpreadCurve shares_along(const std::vector<Transition>& all, const Eigen::VectorXd& before_deg2,
                         const Eigen::VectorXd& after_deg2) {
  constexpr int points = 25;
  constexpr double reach = 5;
  struct Sums {
    double beams = 0, inside = 0, samples = 0, far = 0, expected = 0, simulated = 0;
  };
  std::vector<Sums> sums(points);
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    const double width_deg = std::sqrt(after_deg2[row]), stated_deg = std::sqrt(before_deg2[row]),
                 edge_deg = all[i].place_deg(after_deg2[row]);
    const auto share = [](double inside_deg, double width) {
      return 0.5 * std::erfc(inside_deg / width / std::sqrt(2.0));
    };
    for (const Beside& b : all[i].beams) {
      const double inside = b.inside_deg - edge_deg, at = (inside / width_deg / reach + 1) / 2;
      if (at < 0 || at >= 1) continue;
      Sums& s = sums[static_cast<std::size_t>(at * points)];
      s.beams += 1;
      s.inside += inside;
      s.samples += b.n;
      s.far += b.n * b.far_share;
      s.expected += b.n * share(inside, width_deg);
      s.simulated += b.n * share(inside, stated_deg);
    }
  }
  SpreadCurve curve;
  curve.shows = "share of the farther surface";
  curve.observable = Observable::range_distribution;
  curve.coordinate = Coordinate::edge_distance;
  for (const Sums& s : sums) {
    if (s.samples <= 0) continue;
    const double share = s.far / s.samples, least = 0.5 / s.samples,
                 u = std::sqrt(std::max(least, share * (1 - share)) / s.samples);
    curve.add(s.inside / s.beams, {share, u}, s.simulated / s.samples, s.expected / s.samples);
  }
  return curve;
}

}  // namespace fit::explain::model
