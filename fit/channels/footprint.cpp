// SPDX-License-Identifier: MIT
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>
#include <string>
#include <tuple>
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
constexpr double never = -1e4;  ///< In place of the logarithm of nothing.

/// A beam beside an edge: how much of its light is missing.
struct Dimmed {
  double inside_deg = 0;  ///< From where the bench has the edge; positive on the nearer surface.
  int side = 1;           ///< +1: it met the nearer one.
  double log_share = 0, u = 0;
  double by_geometry = 0;  ///< What of it incidence and range make.
  double other = 0;        ///< Logarithm of the other surface's counts over its own surface's.
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

/// In one capture.
using Dimming = std::vector<Dimmed>;

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

/// Calls for every beam of one side whose samples all met that surface.
template <class Call>
void of_side(const Transition& edge, int side, const Call& call) {
  const double change = edge.crossing_deg();
  for (const Beside& b : edge.beams()) {
    const double inside = b.inside_deg - change;
    if (b.counts > 0 && inside * side > 0 && (side > 0 ? b.far_share <= 0 : b.far_share >= 1))
      call(b, inside);
  }
}

void add_usual(const Transition& edge, int side, Usual& usual) {
  of_side(edge, side, [&](const Beside& b, double inside) {
    if (std::abs(inside) < reach_deg) return;
    usual.counts.add(inside, std::log(b.counts));
    usual.by_law.add(inside, b.log_echo);
  });
}

/// Beams close to the edge, against what their surface usually shows: in this capture, or else in all of
/// them.
void set_beams(EdgeInCaptures& edge) {
  constexpr double lambert_doubt = 0.3;  // of what incidence and range make
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
        if (std::abs(inside) >= reach_deg) return;
        const double geometry = b.log_echo - level_at(usual.by_law, inside),
                     log_share = std::log(b.counts) - level_at(usual.counts, inside);
        edge.beams[k].push_back({b.inside_deg, side, log_share,
                                 std::hypot(surface_doubt, b.u_counts / b.counts, lambert_doubt * geometry),
                                 geometry, other, normal(log_share, odd_size)});
      });
    }
  }
}

bool shows_dip(const std::vector<Dimmed>& list) {
  return std::ranges::any_of(
      list, [](const Dimmed& b) { return b.is_dip(b.log_share - std::min(0.0, b.by_geometry)); });
}

double likelihood_of(const Dimmed& b, double log_light, double power) {
  const double log = power * (log_light + b.by_geometry);
  return (1 - odd_beam) * normal(b.log_share - log, b.u) + odd_beam * b.odd;
}

/// Log-likelihoods of an edge's captures, each given those before.
using Logs = std::vector<double>;

/// How light falls past a place, from both sides of it.
template <class LogLight>
struct Profile {
  LogLight log_light;  ///< Of a beam, and of degrees inside the nearer surface.
  double power = 1;    ///< By which the receiver compresses it.
  double reach_deg = 0, step_deg = 0;

  struct At {
    double likelihood = 1;
    bool shows = false;  ///< A dip, somewhere.
  };
  [[nodiscard]] At at(const Dimming& dimming, double place_deg) const {
    At at;
    for (const Dimmed& b : dimming) {
      const double light = log_light(b, b.inside_deg - place_deg);
      at.shows = at.shows || b.is_dip(power * light);
      at.likelihood *= likelihood_of(b, light, power);
    }
    return at;
  }
};

/// PlaceGrid between the last beam before the edge and the first one behind it, and beyond by a reach.
struct PlaceGrid {
  double from = 0, step = 0;
  std::size_t count = 0;

  PlaceGrid(const Dimming& dimming, double beyond_deg, double step_deg) : step(step_deg) {
    double before = -reach_deg, behind = reach_deg;
    for (const Dimmed& b : dimming) {
      if (b.side < 0) before = std::max(before, b.inside_deg);
      if (b.side > 0) behind = std::min(behind, b.inside_deg);
    }
    from = before - beyond_deg;
    count = static_cast<std::size_t>(std::max(0.0, behind + beyond_deg - from) / step) + 1;
  }
  [[nodiscard]] double at(std::size_t i) const { return from + static_cast<double>(i) * step; }
};

/// Sums over normal weights around every place.
Logs smoothed(const Logs& values, double sigma_deg, double step_deg) {
  constexpr double widths = 3;
  const int reach = static_cast<int>(widths * sigma_deg / step_deg), count = static_cast<int>(values.size());
  Logs weights, sums(values.size());
  for (int k = -reach; k <= reach; ++k)
    weights.push_back(std::exp(-0.5 * std::pow(k * step_deg / sigma_deg, 2)));
  const double all = std::accumulate(weights.begin(), weights.end(), 0.0);
  for (int i = 0; i < count; ++i)
    for (int k = std::max(-reach, -i); k <= std::min(reach, count - 1 - i); ++k)
      sums[static_cast<std::size_t>(i)] +=
          weights[static_cast<std::size_t>(k + reach)] / all * values[static_cast<std::size_t>(i + k)];
  return sums;
}

/// An edge stands in all captures at one place against the bench file's, which is integrated over; stage and
/// fit may have each of them elsewhere by a normal error of unknown size, and now and then by anything; or
/// its light is another's doing. The first capture is given that it shows a dip.
template <class LogLight>
Logs logs_of(const std::vector<Dimming>& dimmings, const Profile<LogLight>& profile) {
  constexpr std::array scatter_deg{0.003, 0.015, 0.06};
  constexpr double elsewhere = 0.05;
  const PlaceGrid places(dimmings.front(), profile.reach_deg, profile.step_deg);
  std::array<Logs, scatter_deg.size()> weights;
  weights.fill(Logs(places.count, 1.0));
  Logs logs;
  double before = 0, shown = 0;
  for (std::size_t i = 0; i < places.count; ++i) {
    const auto at = profile.at(dimmings.front(), places.at(i));
    for (Logs& weight : weights) weight[i] = at.shows ? at.likelihood : 0;
    shown += at.shows ? 1 : 0;
    before += at.shows ? at.likelihood : 0;
  }
  if (!(before > 0)) return Logs(dimmings.size(), never);
  logs.push_back(std::log(before / shown));
  before *= static_cast<double>(weights.size());
  for (std::size_t k = 1; k < dimmings.size(); ++k) {
    Logs here(places.count);
    for (std::size_t i = 0; i < places.count; ++i) here[i] = profile.at(dimmings[k], places.at(i)).likelihood;
    const PlaceGrid own(dimmings[k], profile.reach_deg, profile.step_deg);
    double anywhere = 0;
    for (std::size_t i = 0; i < own.count; ++i) anywhere += profile.at(dimmings[k], own.at(i)).likelihood;
    anywhere *= profile.step_deg / (2 * reach_deg);
    double otherwise = 1;  // as something else dims the beams of this capture
    for (const Dimmed& b : dimmings[k]) otherwise *= b.odd;
    double now = 0;
    for (std::size_t s = 0; s < weights.size(); ++s) {
      const Logs near = smoothed(here, scatter_deg[s], profile.step_deg);
      for (std::size_t i = 0; i < places.count; ++i)
        now += weights[s][i] *= (1 - elsewhere) * near[i] + elsewhere * (anywhere + otherwise) / 2;
    }
    if (!(now > 0)) break;
    logs.push_back(std::log(now / before));
    for (Logs& weight : weights)
      for (double& w : weight) w /= now;
    before = 1;
  }
  logs.resize(dimmings.size(), never);
  return logs;
}

/// Several ways in which an edge may be: the mean of their likelihoods, each with its weight.
class Mixture {
 public:
  void add(Logs logs, double weight = 1) {
    std::partial_sum(logs.begin(), logs.end(), logs.begin());
    all_.emplace_back(std::log(weight), std::move(logs));
    weights_ += weight;
  }
  [[nodiscard]] Logs logs() const {
    Logs joint(all_.front().second.size());
    for (std::size_t k = 0; k < joint.size(); ++k) {
      double most = -1e300, sum = 0;
      for (const auto& [log, logs] : all_) most = std::max(most, log + logs[k]);
      for (const auto& [log, logs] : all_) sum += std::exp(log + logs[k] - most);
      joint[k] = most + std::log(sum / weights_);
    }
    std::adjacent_difference(joint.begin(), joint.end(), joint.begin());
    return joint;
  }

 private:
  std::vector<std::pair<double, Logs>> all_;
  double weights_ = 0;
};

/// An edge past which stray light of the nearer surface is an echo by itself: a small share of the light,
/// which falls to a half within a degree, and says nothing of the beam's width.
Logs halo(const std::vector<Dimming>& dimmings) {
  constexpr std::array leaks{0.003, 0.01, 0.03, 0.1};
  constexpr std::array compressions{1.0, 0.8, 0.65, 0.5, 0.4};
  constexpr double step_deg = 0.1;
  Mixture mixture;
  for (const double half_rad : halos_rad)
    for (const double leak : leaks)
      for (const double power : compressions) {
        const double sigma_deg = half_rad * deg_per_rad / std::sqrt(2 * std::log(2.0));
        const auto log_light = [&](const Dimmed& b, double inside) {
          return b.side < 0 || inside > 0 ? 0
                                          : std::log(leak * std::erfc(-inside / sigma_deg / std::sqrt(2.0)));
        };
        mixture.add(logs_of(dimmings, Profile{log_light, power, 2 * reach_deg, step_deg}));
      }
  return mixture.logs();
}

/// A rim that sends back less light than its surface: a frame, a bevel, paint that ends.
Logs rim(const std::vector<Dimming>& dimmings) {
  constexpr std::array remaining{0.15, 0.25, 0.35, 0.5, 0.65, 0.8};
  constexpr double narrowest_deg = 0.08, wider = 1.25, step_deg = 0.02;
  Mixture mixture;
  for (double width_deg = narrowest_deg; width_deg < reach_deg; width_deg *= wider)
    for (const double share : remaining) {
      const auto log_light = [&](const Dimmed& b, double inside) {
        return b.side > 0 && inside > 0 && inside < width_deg ? std::log(share) : 0;
      };
      mixture.add(logs_of(dimmings, Profile{log_light, 1, 0.1, step_deg}));
    }
  return mixture.logs();
}

/// An edge whose light is another's doing.
Logs odd(const std::vector<Dimming>& dimmings) {
  Logs independent;
  for (const Dimming& dimming : dimmings) {
    double log = 0;
    for (const Dimmed& b : dimming) log += std::log(b.odd);
    independent.push_back(log);
  }
  Mixture mixture;
  mixture.add(std::move(independent));
  mixture.add(halo(dimmings));
  mixture.add(rim(dimmings));
  return mixture.logs();
}

/// Log-likelihoods of a beam that wide. A receiver tells the light of the echo that it ranges, or of both.
Logs beam(const std::vector<Dimming>& dimmings, const Logs& of_odd, double width_deg) {
  constexpr double least_share = 0.02, widths = 2.7, steps = 4, finest_deg = 0.005;
  const double finest = std::max(finest_deg, width_deg / steps);
  const auto share = [&](const Dimmed& b, double inside) {
    return 0.5 * std::erfc(-b.side * inside / width_deg / std::sqrt(2.0));
  };
  const auto of_own = [&](const Dimmed& b, double inside) {
    return std::log(std::max(least_share, share(b, inside)));
  };
  Mixture mixture;
  mixture.add(of_odd, odd_edge);
  constexpr double each = (1 - odd_edge) / (2 * powers.size());
  for (const double power : powers) {
    const auto of_both = [&](const Dimmed& b, double inside) {
      const double own = share(b, inside);
      return std::log(own + (1 - own) * std::exp(b.other / power));
    };
    mixture.add(logs_of(dimmings, Profile{of_own, power, widths * width_deg, finest}), each);
    mixture.add(logs_of(dimmings, Profile{of_both, power, widths * width_deg, finest}), each);
  }
  return mixture.logs();
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

/// From the first capture on that shows a dip: receivers whose intensity is no measure of it show none.
std::vector<EdgeInCaptures> edges_of(const Reduced& reduced) {
  constexpr std::size_t most_rows = 60;  // computing time
  std::map<std::tuple<int, std::optional<std::string>, double>, EdgeInCaptures> by_edge;
  for (Transition& seen : model::transitions(reduced)) {
    if (seen.at().gap_mm < apart_mm) continue;
    const CaptureInfo& capture = reduced.captures[static_cast<std::size_t>(seen.capture())];
    by_edge[{seen.edge(), capture.target, capture.target_shift_mm}].captures.push_back(std::move(seen));
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
  const Logs of_odd = odd(edge.beams);
  std::map<double, Logs> by_width;
  for (std::size_t k = 0; k < edge.beams.size(); ++k)
    rows.push_back(
        {edge.captures[k].at(), edge.captures[k].capture(), model::WidthLikelihood([&](double width_deg) {
           const auto [logs, is_new] = by_width.try_emplace(width_deg);
           if (is_new) logs->second = beam(edge.beams, of_odd, width_deg);
           return logs->second[k];
         })});
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
