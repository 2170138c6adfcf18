// SPDX-License-Identifier: MIT
#include "fit/explain/experiment/experiments.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "fit/explain/scene/scene.hpp"

namespace fit::explain {
namespace {

constexpr double longest_movable_mm = 3000;   // nobody moves a wall
constexpr std::size_t fewest_placements = 4;  // that are worth carrying a target about

CaptureInfo whole_scene(const Bench& bench, double stage_deg, std::optional<double> celsius = {}) {
  CaptureInfo c;
  c.stage_rad = stage_deg * rad_per_deg;
  c.first_step = bench.lidar.first_step;
  c.last_step = bench.lidar.steps - 1;
  c.temperature_c = celsius;
  return c;
}

}  // namespace

CaptureInfo aimed_at(const Bench& bench, const Target& target) {
  const Eigen::Vector2d middle = (target.from_mm + target.to_mm) / 2;
  const double bearing = std::atan2(middle.y(), middle.x()) - bench.lidar.mount.yaw_rad.value;
  const int centre =
      bench.lidar.front_step + static_cast<int>(std::lround(wrap_angle(bearing) / bench.lidar.step_rad));
  CaptureInfo c;
  c.first_step = std::clamp(centre - 8, bench.lidar.first_step, bench.lidar.steps - 1);
  c.last_step = std::clamp(centre + 8, bench.lidar.first_step, bench.lidar.steps - 1);
  c.target = target.name;
  return c;
}

namespace {

/// Of captures that follow each other after that pause, from that time after power-on.
Experiment made(Experiment::Kind kind, std::string title, int scans, double pause_s, double first_s,
                std::vector<CaptureInfo> captures) {
  Experiment e;
  e.kind = kind;
  e.title = std::move(title);
  e.scans = scans;
  e.captures = std::move(captures);
  int id = 0;
  double before = 0;
  for (CaptureInfo& c : e.captures) {
    const double since_s = pause_s * id;
    c.id = ++id;
    c.started_us = static_cast<std::int64_t>(since_s * 1e6);
    c.since_power_on_s = first_s + since_s;
    if (c.approach == 0) c.approach = c.stage_rad > before ? 1 : c.stage_rad < before ? -1 : 0;
    before = c.stage_rad;
  }
  return e;
}

/// Stage angles up and down again.
std::vector<CaptureInfo> from_both_sides(const Bench& bench, double from_deg, double to_deg,
                                         double step_deg) {
  std::vector<CaptureInfo> captures;
  for (double angle = from_deg; angle <= to_deg; angle += step_deg)
    captures.push_back(whole_scene(bench, angle));
  for (std::size_t i = captures.size(); i-- > 0;) captures.push_back(captures[i]);
  return captures;
}

/// In whole millimetres: an operator moves it by hand.
double distance_of(const Target& target) {
  return std::round(std::abs(target.from_mm.dot(target.outward_normal())));
}

/// One target that is moved and covered.
std::vector<Experiment> with_placements(const Bench& bench, const Target& target) {
  using Kind = Experiment::Kind;
  std::vector<Experiment> list;
  std::vector<CaptureInfo> captures;
  const auto place = [&](double shift_mm, double rho) {
    CaptureInfo& c = captures.emplace_back(aimed_at(bench, target));
    c.target_shift_mm = shift_mm;
    c.reflectance = rho;
  };
  const auto add = [&](Kind kind, const std::string& how) {
    list.push_back(
        made(kind, "Target '" + target.name + "' " + how, 60, 20, 3600, std::exchange(captures, {})));
  };
  const double nominal = distance_of(target);
  for (const double rho : {0.85, 0.4, 0.12})
    for (const double away_mm : {300, 450, 650, 900, 1250, 1700, 2300, 3100, 4200, 5700, 7700})
      place(away_mm - nominal, rho);
  add(Kind::ladder, "at many distances, bright and dark");
  for (const double shift_mm : {0.0, 1000.0})
    for (const double rho : {0.9, 0.5, 0.28, 0.16, 0.09, 0.05}) place(shift_mm, rho);
  add(Kind::greys, "in many greys at two distances");
  for (const double away_mm : {2300, 4200, 6500, 9800})  // the weakest echoes that a bench can make
    for (const double rho : {0.2, 0.1, 0.05, 0.02}) place(away_mm - nominal, rho);
  add(Kind::dark, "in dark greys, far away");
  return list;
}

Experiment heat(const Bench& bench) {
  std::vector<CaptureInfo> captures;
  for (const double celsius : {20.0, 26.0, 32.0, 38.0, 32.0, 26.0, 20.0})
    captures.push_back(whole_scene(bench, 0, celsius));
  return made(Experiment::Kind::heat, "The lidar's housing heated and cooled after warm-up", 40, 900, 7200,
              std::move(captures));
}

Experiment cold_start(const Bench& bench) {
  constexpr std::size_t minutes = 60;
  return made(Experiment::Kind::cold_start, "From a cold start, at a housing temperature that is held", 10,
              60, 0, std::vector(minutes, whole_scene(bench, 0, steady_c)));
}

Experiment turning(const Bench& bench, double from_deg, double to_deg) {
  std::vector<CaptureInfo> captures;
  const double middle_deg = (from_deg + to_deg) / 2, reach_deg = std::min(60.0, (to_deg - from_deg) / 2);
  for (const double rate : {10.0, 30.0})
    for (const double sign : {1.0, -1.0}) {
      CaptureInfo& c = captures.emplace_back(whole_scene(bench, middle_deg - sign * reach_deg / 2));
      c.stage_rate_rad_s = sign * rate * rad_per_deg;
      c.approach = sign > 0 ? 1 : -1;
    }
  return made(Experiment::Kind::turning, "The stage turns at two rates, both ways", 40, 20, 1800,
              std::move(captures));
}

}  // namespace

bool is_movable(const Target& target) { return (target.to_mm - target.from_mm).norm() <= longest_movable_mm; }

void leave_out_hidden(Experiment& experiment, const Bench& bench) {
  std::erase_if(experiment.captures, [&](const CaptureInfo& c) {
    if (!c.target) return false;
    const double middle = bench.lidar.beam_angle((c.first_step + c.last_step) / 2.0);
    const Sight sight = Scene(bench, Nuisance(bench), c).look(c.stage_rad, middle);
    return sight.target < 0 || bench.target_at(sight.target).name != *c.target;
  });
}

std::vector<Experiment> possible_experiments(const Bench& bench, const StageTravel& travel) {
  const double from = travel.from_rad * deg_per_rad, to = travel.to_rad * deg_per_rad;
  std::vector<Experiment> list;
  list.push_back(made(Experiment::Kind::all_round,
                      "The whole scene from stage angles all round, from both sides", 10, 12, 1800,
                      from_both_sides(bench, std::max(-180.0, from), std::min(165.0, to), 15)));
  list.push_back(made(Experiment::Kind::both_sides, "Small stage steps from both sides", 20, 6, 1800,
                      from_both_sides(bench, std::max(-8.0, from), std::min(8.0, to), 0.37)));
  for (const Target& target : bench.targets) {
    if (!is_movable(target)) continue;
    for (Experiment& e : with_placements(bench, target)) {
      leave_out_hidden(e, bench);
      if (e.captures.size() >= fewest_placements) list.push_back(std::move(e));
    }
  }
  list.push_back(heat(bench));
  list.push_back(cold_start(bench));
  list.push_back(turning(bench, from, to));
  return list;
}

std::vector<Experiment> experiments_by_hand(const Bench& bench, const std::vector<const Recording*>& so_far) {
  std::vector<Experiment> list;
  for (const Target& target : bench.targets) {
    const bool used = std::ranges::any_of(so_far, [&](const Recording* recording) {
      return std::ranges::any_of(recording->captures(),
                                 [&](const CaptureInfo& c) { return c.target == target.name; });
    });
    if (!used) continue;
    const double nominal = distance_of(target);
    const auto add = [&](const char* title, const std::vector<double>& distances,
                         const std::vector<double>& greys) {
      std::vector<CaptureInfo> captures;
      for (const double rho : greys)
        for (const double distance : distances) {
          CaptureInfo& c = captures.emplace_back(whole_scene(bench, 0));
          c.target = target.name;
          c.target_shift_mm = distance - nominal;
          if (greys.size() > 1) c.reflectance = rho;
        }
      list.push_back(made(Experiment::Kind::ladder, "Target '" + target.name + "' " + title, 100, 60, 3600,
                          std::move(captures)));
      list.back().by_hand = true;
    };
    const double white = target.reflectance.value_or(0.8);
    add("at close and far distances", {300, 500, 700, 1000, 1400, 2000, 2800, 4000}, {white});
    add("in steps of 70 mm", {600, 670, 740, 810, 880, 950, 1020, 1090, 1160, 1230}, {white});
    add("in three greys at three distances", {600, 1200, 2400}, {0.85, 0.35, 0.1});
  }
  return list;
}

namespace {

/// Whether a target stands as it did in another capture.
bool stands_alike(const CaptureInfo& one, const CaptureInfo& other) {
  return one.target == other.target && one.target_shift_mm == other.target_shift_mm &&
         one.reflectance == other.reflectance;
}

std::size_t placements(const Experiment& e) {
  if (e.by_hand) return e.captures.size();
  std::size_t count = 0;
  for (std::size_t i = 0; i < e.captures.size(); ++i)
    if (e.captures[i].target && (i == 0 || !stands_alike(e.captures[i - 1], e.captures[i]))) ++count;
  return count;
}

}  // namespace

double work_s(const Experiment& e) {
  constexpr double by_hand_s = 300, cooling_s = 7200;
  if (e.captures.empty()) return 0;
  const double passed =
      static_cast<double>(e.captures.back().started_us - e.captures.front().started_us) * 1e-6;
  return passed + by_hand_s * static_cast<double>(placements(e)) +
         (e.steady ? e.captures.front().since_power_on_s.value_or(0) : 0) +
         (e.kind == Experiment::Kind::cold_start ? cooling_s : 0);
}

}  // namespace fit::explain
