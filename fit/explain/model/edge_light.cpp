// SPDX-License-Identifier: MIT
#include "fit/explain/model/edge_light.hpp"

#include <array>
#include <cmath>
#include <numeric>
#include <utility>

#include "fit/explain/model/edge_place.hpp"
#include "fit/mechanism.hpp"

namespace fit::explain::model {
namespace {

/// A dark rim, a frame: an edge whose light is another's doing, and so is a single beam's.
constexpr double odd_edge = 0.1, odd_beam = 0.02, odd_size = 0.7;
/// Counts are a power of the echo; receivers compress.
constexpr std::array powers{1.0, 0.7, 0.4};

double normal(double off, double sigma) {
  return std::exp(-0.5 * std::pow(off / sigma, 2)) / (std::sqrt(2 * pi) * sigma);
}

/// Of a beam that something else dims.
double odd_likelihood(const Dimmed& b) { return normal(b.log_share, odd_size); }

double likelihood_of(const Dimmed& b, double log_light, double power) {
  const double log = power * (log_light + b.by_geometry);
  return (1 - odd_beam) * normal(b.log_share - log, b.u) + odd_beam * odd_likelihood(b);
}

/// Log-likelihoods of an edge's captures, each given those before.
using Logs = std::vector<double>;

/// How light falls past a place, from both sides of it.
template <class LogLight>
struct Profile {
  LogLight log_light;  ///< Of a beam, were it so many degrees inside the nearer surface.
  double power = 1;    ///< By which the receiver compresses it.
  double beyond_deg = 0, step_deg = 0;

  struct At {
    double likelihood = 1;
    bool shows = false;  ///< A dip, somewhere.
  };
  [[nodiscard]] At at(const Dimming& dimming, double place_deg) const {
    At at;
    for (const Dimmed& b : dimming) {
      const double light = log_light(b, b.inside_deg - place_deg) - log_light(b, b.usual_deg - place_deg);
      at.shows = at.shows || b.is_dip(power * light);
      at.likelihood *= likelihood_of(b, light, power);
    }
    return at;
  }
};

// clang 14 deduces no aggregate's arguments.
template <class LogLight>
Profile(LogLight, double, double, double) -> Profile<LogLight>;

/// Between the last beam before the edge and the first one behind it, and beyond by a reach.
template <class LogLight>
PlaceGrid places_of(const Dimming& dimming, const Profile<LogLight>& profile) {
  double before = -light_reach_deg, behind = light_reach_deg;
  for (const Dimmed& b : dimming) {
    if (b.side < 0) before = std::max(before, b.inside_deg);
    if (b.side > 0) behind = std::min(behind, b.inside_deg);
  }
  return {before - profile.beyond_deg, behind + profile.beyond_deg, profile.step_deg};
}

/// Of an edge's light along its captures, its place integrated over; or its light is another's doing. The
/// first capture is given that it shows a dip.
template <class LogLight>
Logs logs_of(const std::vector<Dimming>& dimmings, const Profile<LogLight>& profile) {
  const PlaceGrid places = places_of(dimmings.front(), profile);
  Logs here(places.count);
  double shown = 0, first = 0;
  for (std::size_t i = 0; i < places.count; ++i) {
    const auto at = profile.at(dimmings.front(), places.at(i));
    here[i] = at.shows ? at.likelihood : 0;
    shown += at.shows ? 1 : 0;
    first += here[i];
  }
  if (!(first > 0)) return Logs(dimmings.size(), log_never);
  Logs logs{std::log(first / shown)};
  EdgePlace edge(here, profile.step_deg);
  for (std::size_t k = 1; k < dimmings.size() && logs.back() > log_never; ++k) {
    for (std::size_t i = 0; i < places.count; ++i) here[i] = profile.at(dimmings[k], places.at(i)).likelihood;
    const PlaceGrid own = places_of(dimmings[k], profile);
    double anywhere = 0;
    for (std::size_t i = 0; i < own.count; ++i) anywhere += profile.at(dimmings[k], own.at(i)).likelihood;
    anywhere *= profile.step_deg / (2 * light_reach_deg);
    double otherwise = 1;  // as something else dims the beams of this capture
    for (const Dimmed& b : dimmings[k]) otherwise *= odd_likelihood(b);
    logs.push_back(edge.next(here, (anywhere + otherwise) / 2));
  }
  logs.resize(dimmings.size(), log_never);
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
        mixture.add(logs_of(dimmings, Profile{log_light, power, 2 * light_reach_deg, step_deg}));
      }
  return mixture.logs();
}

/// A rim that sends back less light than its surface: a frame, a bevel, paint that ends.
Logs rim(const std::vector<Dimming>& dimmings) {
  constexpr std::array remaining{0.15, 0.25, 0.35, 0.5, 0.65, 0.8};
  constexpr double narrowest_deg = 0.08, wider = 1.25, step_deg = 0.02;
  Mixture mixture;
  for (double width_deg = narrowest_deg; width_deg < light_reach_deg; width_deg *= wider)
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
    for (const Dimmed& b : dimming) log += std::log(odd_likelihood(b));
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

}  // namespace

EdgeLight::EdgeLight(std::vector<Dimming> captures) : captures_(std::move(captures)), odd_(odd(captures_)) {}

std::vector<double> EdgeLight::log_likelihoods(double width_deg) const {
  return beam(captures_, odd_, width_deg);
}

}  // namespace fit::explain::model
