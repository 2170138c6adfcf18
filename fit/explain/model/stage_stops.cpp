// SPDX-License-Identifier: MIT
#include "fit/explain/model/stage_stops.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "fit/bench/accuracy.hpp"
#include "fit/explain/model/gaussian.hpp"
#include "fit/explain/model/mean_model.hpp"

namespace fit::explain {
namespace {

/// The angle by which the stage seems to be off at a stop, and its variance by the noise of the means.
struct Seen {
  double stage_rad = 0, time_s = 0;
  double along = 0, information = 0;
  [[nodiscard]] double angle_rad() const { return along / information; }
  [[nodiscard]] double variance_rad2() const { return 1 / information; }
};

std::vector<Seen> seen_at(const std::vector<Stop>& stops, const Reduced& reduced, const MeanModel& model) {
  std::vector<std::size_t> stop_of(reduced.groups.size(), stops.size());
  std::vector<Seen> list(stops.size());
  for (std::size_t s = 0; s < stops.size(); ++s) {
    const Group &first = reduced.groups[stops[s].first_group],
                &last = reduced.groups[stops[s].last_group - 1];
    list[s].stage_rad = (first.stage_rad + last.stage_rad) / 2;
    list[s].time_s = (first.time_s + last.time_s) / 2;
    for (std::size_t g = stops[s].first_group; g < stops[s].last_group; ++g) stop_of[g] = s;
  }
  const Eigen::VectorXd residual = model.residual();
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    const std::size_t s = stop_of[static_cast<std::size_t>(model.cell(i).group)];
    if (s == stops.size()) continue;
    const double weight = 1 / std::pow(model.sigma_of_mean(i), 2),
                 sensitivity = model.cell(i).sight.stage_sensitivity();
    list[s].along += weight * sensitivity * residual[i];
    list[s].information += weight * sensitivity * sensitivity;
  }
  return list;
}

/// By how much a stop lies off the line through its neighbours.
struct Bend {
  double square = 0, of_noise = 0;  ///< What the noise of the means leaves of it on average.
  double of_stops = 0;              ///< How often the variance of a stop is in it.
};

std::vector<Bend> bends_along(std::vector<Seen> list, double Seen::*place) {
  std::ranges::stable_sort(list, {}, place);
  std::vector<Bend> bends;
  for (std::size_t i = 1; i + 1 < list.size(); ++i) {
    const Seen &before = list[i - 1], &here = list[i], &after = list[i + 1];
    const double way = after.*place - before.*place, to = way > 0 ? (here.*place - before.*place) / way : 0.5,
                 from = 1 - to;
    const double off = here.angle_rad() - from * before.angle_rad() - to * after.angle_rad();
    bends.push_back(
        {off * off,
         here.variance_rad2() + from * from * before.variance_rad2() + to * to * after.variance_rad2(),
         1 + from * from + to * to});
  }
  return bends;
}

/// Of that variance of stops. Neighbouring bends have two stops in common: each counts half.
double log_likelihood(const std::vector<Bend>& bends, double variance) {
  double sum = 0;
  for (const Bend& bend : bends) {
    const double expected = bend.of_noise + bend.of_stops * variance;
    sum -= (std::log(expected) + bend.square / expected) / 4;
  }
  return sum;
}

/// Posterior mean of a variance whose root is uniform up to `most_rad` before. `logs_at`: log-likelihoods
/// there, of all that may be.
template <class LogsAt>
double mean_variance(double most_rad, const LogsAt& logs_at) {
  constexpr int steps = 40;
  std::vector<double> logs, variances;
  for (int step = 0; step <= steps; ++step) {
    const double variance = std::pow(most_rad * step / steps, 2);
    for (const double log : logs_at(variance)) {
      logs.push_back(log);
      variances.push_back(variance);
    }
  }
  const double all = inference::log_sum(logs);
  double mean = 0;
  for (std::size_t i = 0; i < logs.size(); ++i) mean += std::exp(logs[i] - all) * variances[i];
  return mean;
}

/// Both orders are of the same stops; or something that changes with the other place makes the bends along
/// one of them larger, nobody knows by how much.
double variance_by(const std::vector<Bend>& in_time, const std::vector<Bend>& along_stage, double most_rad) {
  constexpr std::array more{0.25, 1.0, 4.0, 16.0, 64.0, 256.0};
  const auto disturbed = [&](const std::vector<Bend>& bends, double variance) {
    std::vector<double> larger;
    for (const double times : more)
      larger.push_back(log_likelihood(bends, variance + times * most_rad * most_rad));
    return inference::log_sum(larger) - std::log(more.size());
  };
  return mean_variance(most_rad, [&](double variance) {
    const double time = log_likelihood(in_time, variance), stage = log_likelihood(along_stage, variance);
    return std::array{(time + stage) / 2, (disturbed(in_time, variance) + stage) / 2,
                      (time + disturbed(along_stage, variance)) / 2};
  });
}

/// How captures of one stop differ from the one before.
std::vector<Bend> steps_within(const Reduced& reduced, const MeanModel& model) {
  std::vector<Stop> groups;
  for (std::size_t g = 0; g < reduced.groups.size(); ++g) groups.push_back({g, g + 1});
  const std::vector<Seen> seen = seen_at(groups, reduced, model);
  std::vector<Bend> steps;
  for (std::size_t g = 1; g < seen.size(); ++g) {
    if (!stands_still(reduced, g) || reduced.groups[g - 1].capture == reduced.groups[g].capture) continue;
    const Seen &before = seen[g - 1], &now = seen[g];
    if (!(before.information > 0) || !(now.information > 0)) continue;
    const double off = now.angle_rad() - before.angle_rad();
    steps.push_back({off * off, before.variance_rad2() + now.variance_rad2(), 2});
  }
  return steps;
}

double most_of_a_stop_rad(const Bench& bench) {
  return std::hypot(bench.stage_resolution_rad / std::sqrt(12.0), accuracy_of(bench).stage_position_rad.u);
}

}  // namespace

bool stands_still(const Reduced& reduced, std::size_t group) {
  if (group == 0) return false;
  const Group &before = reduced.groups[group - 1], &now = reduced.groups[group];
  return !is_turning(reduced.capture_of(before)) && !is_turning(reduced.capture_of(now)) &&
         before.stage_rad == now.stage_rad;
}

std::vector<Stop> stops_of(const Reduced& reduced) {
  const auto goes_on = [&](std::size_t g) {
    if (g == 0) return false;
    const Group &before = reduced.groups[g - 1], &now = reduced.groups[g];
    return stands_still(reduced, g) || (before.capture == now.capture && is_turning(reduced.capture_of(now)));
  };
  std::vector<Stop> stops;
  for (std::size_t g = 0; g < reduced.groups.size(); ++g) {
    if (goes_on(g))
      stops.back().last_group = g + 1;
    else
      stops.push_back({g, g + 1});
  }
  if (stops.size() == 1) stops.clear();
  return stops;
}

double variance_of_stops_rad2(const Reduced& reduced, const MeanModel& model) {
  const double most_rad = most_of_a_stop_rad(reduced.bench);
  std::vector<Seen> list = seen_at(stops_of(reduced), reduced, model);
  std::erase_if(list, [](const Seen& one) { return !(one.information > 0); });
  if (list.empty() || !(most_rad > 0)) return 0;
  return variance_by(bends_along(list, &Seen::time_s), bends_along(list, &Seen::stage_rad), most_rad);
}

double variance_within_stops_rad2(const Reduced& reduced, const MeanModel& model) {
  const double most_rad = most_of_a_stop_rad(reduced.bench);
  const std::vector<Bend> steps = steps_within(reduced, model);
  if (steps.empty() || !(most_rad > 0)) return 0;
  return mean_variance(most_rad,
                       [&](double variance) { return std::array{log_likelihood(steps, variance)}; });
}

}  // namespace fit::explain
