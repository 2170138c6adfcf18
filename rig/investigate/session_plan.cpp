// SPDX-License-Identifier: MIT
#include "rig/investigate/session_plan.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>

#include "fit/mechanism.hpp"
#include "rig/report/explain_procedure.hpp"

namespace rig::investigate {
namespace {

using fit::Bench;
using fit::CaptureInfo;
using fit::explain::Experiment;
using fit::explain::StageTravel;

constexpr double usual_reach_deg = 170;
constexpr double usual_reflectance = 0.5;

CaptureInfo whole_scene_at(const Bench& bench, double stage_deg, int approach) {
  CaptureInfo c;
  c.stage_rad = stage_deg * fit::rad_per_deg;
  c.approach = approach;
  c.first_step = bench.lidar.first_step;
  c.last_step = bench.lidar.steps - 1;
  return c;
}

/// A second of scans is little beside a move of the stage, and five are little beside an operator's minutes.
constexpr int scans_a_stop = 40, scans_by_hand = 200;

/// Visited in that order, each come to from where the one before was.
Experiment turns(const Bench& bench, const std::vector<double>& angles_deg) {
  Experiment e;
  e.kind = Experiment::Kind::all_round;
  e.scans = scans_a_stop;
  double before = 0;
  for (const double angle : angles_deg) {
    e.captures.push_back(whole_scene_at(bench, angle, angle > before ? 1 : angle < before ? -1 : 0));
    before = angle;
  }
  return e;
}

/// Every second one on the way up, the others on the way back.
std::vector<double> up_and_down(std::vector<double> angles_deg) {
  std::ranges::sort(angles_deg);
  std::vector<double> up, down;
  for (std::size_t i = 0; i < angles_deg.size(); ++i) (i % 2 == 0 ? up : down).push_back(angles_deg[i]);
  std::ranges::reverse(down);
  up.insert(up.end(), down.begin(), down.end());
  return up;
}

double rounded_deg(double deg) { return std::round(100 * deg) / 100; }

CaptureInfo placed(const Bench& bench, const fit::Target& target, double shift_mm, double reflectance) {
  CaptureInfo c = fit::explain::aimed_at(bench, target);
  c.target_shift_mm = std::round(shift_mm);
  c.reflectance = std::round(100 * reflectance) / 100;
  return c;
}

Experiment placements(std::vector<CaptureInfo> captures) {
  Experiment e;
  e.kind = Experiment::Kind::ladder;
  e.scans = scans_by_hand;
  e.captures = std::move(captures);
  return e;
}

double distance_mm(const fit::Target& target) {
  return std::abs(target.from_mm.dot(target.outward_normal()));
}

/// A few placements of the target that can stand in most places; empty if none can be moved about.
Experiment few_placements(const Bench& bench) {
  Experiment best;
  for (const fit::Target& target : bench.targets) {
    if (!fit::explain::is_movable(target)) continue;
    std::vector<CaptureInfo> list;
    for (const double away_mm : {500, 1100, 2400})
      for (const double reflectance : {0.85, 0.12})
        list.push_back(placed(bench, target, away_mm - distance_mm(target), reflectance));
    Experiment e = placements(std::move(list));
    fit::explain::leave_out_hidden(e, bench);
    if (e.captures.size() > best.captures.size()) best = std::move(e);
  }
  return best;
}

bool is_turn(const CaptureInfo& c) { return !c.target && !fit::is_turning(c); }

/// Values without near repetitions, ascending.
std::vector<double> different(std::vector<double> values, double least) {
  std::ranges::sort(values);
  std::vector<double> list;
  for (const double v : values)
    if (list.empty() || v - list.back() > least) list.push_back(v);
  return list;
}

/// In the middle of the widest gaps, `count` of them.
std::vector<double> between(std::vector<double> values, std::size_t count) {
  std::vector<double> middles;
  while (middles.size() < count && values.size() > 1) {
    std::size_t widest = 1;
    for (std::size_t i = 2; i < values.size(); ++i)
      if (values[i] - values[i - 1] > values[widest] - values[widest - 1]) widest = i;
    const double middle = (values[widest] + values[widest - 1]) / 2;
    middles.push_back(middle);
    values.insert(values.begin() + static_cast<std::ptrdiff_t>(widest), middle);
  }
  return middles;
}

/// Stage angles as far from all of these, and from each other, as there are.
std::vector<double> farthest_from(std::vector<double> used_deg, double from_deg, double to_deg,
                                  std::size_t count) {
  constexpr double places = 1440;
  std::vector<double> found;
  for (; count > 0; --count) {
    double best = from_deg, farthest = -1;
    for (int i = 0; i <= static_cast<int>(places); ++i) {
      const double angle = from_deg + (to_deg - from_deg) * i / places;
      double nearest = 1e9;
      for (const double other : used_deg) nearest = std::min(nearest, std::abs(angle - other));
      if (nearest > farthest + 1e-9) farthest = nearest, best = angle;
    }
    found.push_back(rounded_deg(best));
    used_deg.push_back(best);
  }
  return found;
}

/// Of the target that was moved most: distances and greys between those that were recorded.
Experiment fresh_placements(const Bench& bench, const std::vector<CaptureInfo>& so_far) {
  const fit::Target* moved = nullptr;
  std::size_t most = 1;
  for (const fit::Target& target : bench.targets) {
    std::set<std::pair<double, double>> places;
    for (const CaptureInfo& c : so_far)
      if (c.target == target.name) places.emplace(c.target_shift_mm, c.reflectance.value_or(-1));
    if (places.size() > most) most = places.size(), moved = &target;
  }
  if (!moved) return {};
  std::vector<double> shifts, greys;
  for (const CaptureInfo& c : so_far)
    if (c.target == moved->name) {
      shifts.push_back(c.target_shift_mm);
      if (c.reflectance) greys.push_back(std::log(*c.reflectance));
    }
  std::vector<double> new_shifts = between(different(shifts, 5), 4),
                      new_greys = between(different(greys, 0.05), 2);
  if (new_shifts.empty()) new_shifts = {shifts.front()};
  std::vector<CaptureInfo> list;
  for (std::size_t i = 0; i < new_shifts.size(); ++i)
    list.push_back(placed(bench, *moved, new_shifts[i],
                          new_greys.empty() ? moved->reflectance.value_or(usual_reflectance)
                                            : std::exp(new_greys[i % new_greys.size()])));
  Experiment e = placements(std::move(list));
  fit::explain::leave_out_hidden(e, bench);
  return e;
}

Experiment fresh_turning(const Bench& bench, const StageTravel& travel,
                         const std::vector<CaptureInfo>& so_far) {
  std::vector<double> rates;
  for (const CaptureInfo& c : so_far)
    if (fit::is_turning(c)) rates.push_back(std::abs(c.stage_rate_rad_s) * fit::deg_per_rad);
  if (rates.empty()) return {};
  rates = different(std::move(rates), 0.5);
  const double rate = rates.size() > 1 ? between(rates, 1).front() : 0.6 * rates.front();
  const double reach =
      std::min({60.0, -travel.from_rad * fit::deg_per_rad, travel.to_rad * fit::deg_per_rad});
  Experiment e;
  e.kind = Experiment::Kind::turning;
  e.scans = 40;
  for (const double sign : {1.0, -1.0}) {
    CaptureInfo c = whole_scene_at(bench, -sign * reach / 2, sign > 0 ? 1 : -1);
    c.stage_rate_rad_s = sign * rate * fit::rad_per_deg;
    e.captures.push_back(c);
  }
  return e;
}

std::vector<double> temperatures_of(const std::vector<CaptureInfo>& so_far) {
  std::vector<double> temperatures;
  for (const CaptureInfo& c : so_far)
    if (c.temperature_c) temperatures.push_back(*c.temperature_c);
  return different(std::move(temperatures), 1);
}

Experiment at_temperatures(const Bench& bench, const std::vector<double>& celsius) {
  Experiment e;
  e.kind = Experiment::Kind::heat;
  e.scans = scans_by_hand;
  for (const double t : celsius) {
    CaptureInfo c = whole_scene_at(bench, 0, 0);
    c.temperature_c = std::round(t);
    e.captures.push_back(c);
  }
  return e;
}

/// A temperature of the housing that was not recorded, if it was heated.
Experiment fresh_heat(const Bench& bench, const std::vector<CaptureInfo>& so_far) {
  const std::vector<double> temperatures = temperatures_of(so_far);
  return temperatures.size() < 2 ? Experiment{} : at_temperatures(bench, between(temperatures, 1));
}

/// From the first capture to the last, on the sessions' clock.
double watched_s(const std::vector<CaptureInfo>& so_far) {
  const auto [first, last] = std::ranges::minmax_element(so_far, {}, &CaptureInfo::started_us);
  return static_cast<double>(last->started_us - first->started_us) * 1e-6;
}

constexpr double long_enough_s = 600;

/// One stage angle for a quarter of an hour.
SessionPlan watch(const std::string& about) {
  return {"One stage angle for a quarter of an hour",
          about,
          {},
          "  - move: {to_deg: 0}\n  - for-each: {minute: {from: 1, to: 15, step: 1}}\n    steps:\n      - "
          "capture: {samples: 20}\n"
          "      - wait: {seconds: 59}\n"};
}

/// A stretch of the experiment that possible_experiments() knows by that kind; empty if the bench cannot do
/// it.
Experiment known_experiment(const Bench& bench, const StageTravel& travel, Experiment::Kind kind) {
  for (Experiment& e : fit::explain::possible_experiments(bench, travel))
    if (e.kind == kind) return std::move(e);
  return {};
}

std::string number_text(double value) { return fit::rounded(value, 6); }

/// Prompts that undo what an experiment's steps did to the bench: what is recorded next is before the bench
/// as its file says.
std::string put_back(const Experiment& e, const Bench& bench) {
  std::set<std::string> moved;
  bool heated = false;
  for (const CaptureInfo& c : e.captures) {
    if (c.target && (e.kind == Experiment::Kind::ladder || e.kind == Experiment::Kind::greys ||
                     e.kind == Experiment::Kind::dark))
      moved.insert(*c.target);
    heated = heated || c.temperature_c.value_or(fit::explain::steady_c) != fit::explain::steady_c;
  }
  std::string text;
  for (const std::string& name : moved) {
    const fit::Target* target = bench.target(name);
    const std::string grey = target && target->reflectance ? number_text(*target->reflectance) : "";
    text += "  - prompt:\n      title: " + yaml_quoted(name + ": back in its place") + "\n      text: " +
            yaml_quoted("Put '" + name + "' back where the bench file has it" +
                        (grey.empty() ? "." : ", with its own surface (reflectance " + grey + ").")) +
            "\n      place: {target: " + yaml_quoted(name) + ", shift_mm: 0" +
            (grey.empty() ? "" : ", reflectance: " + grey) + "}\n      until: {echo: false}\n";
  }
  if (heated)
    text += "  - prompt:\n      title: \"Lidar's housing back at " + number_text(fit::explain::steady_c) +
            " C\"\n      text: \"Let the lidar's housing come back to " +
            number_text(fit::explain::steady_c) +
            " C.\"\n      place: {temperature_c: " + number_text(fit::explain::steady_c) + "}\n";
  return text;
}

}  // namespace

std::vector<CaptureInfo> SessionPlan::captures() const {
  std::vector<CaptureInfo> all;
  for (const Experiment& part : parts) all.insert(all.end(), part.captures.begin(), part.captures.end());
  return all;
}

StageTravel travel_of(const StageLimits& limits) {
  return {std::max(-usual_reach_deg, limits.min_deg) * fit::rad_per_deg,
          std::min(usual_reach_deg, limits.max_deg) * fit::rad_per_deg};
}

SessionPlan first_plan(const Bench& bench, const StageLimits& limits, bool with_hand) {
  constexpr int stops = 14;
  const StageTravel travel = travel_of(limits);
  const double from = travel.from_rad * fit::deg_per_rad, to = travel.to_rad * fit::deg_per_rad;
  std::vector<double> angles;
  for (int i = 0; i < stops; ++i)  // Unevenly, so that no period of gears or of the scan hides between them.
    angles.push_back(rounded_deg(from + (to - from) * (i + 0.5 + 0.35 * std::sin(2.4 * i)) / stops));
  SessionPlan plan{"A short recording from several stage angles",
                   "What does the bench show that its file does not predict?",
                   {},
                   ""};
  plan.parts.push_back(turns(bench, up_and_down(std::move(angles))));
  if (!with_hand) return plan;
  Experiment by_hand = few_placements(bench);
  if (by_hand.captures.empty()) return plan;
  plan.title += ", and at a few distances and greys";
  plan.parts.push_back(std::move(by_hand));
  return plan;
}

std::vector<SessionPlan> surveys(const Bench& bench, const StageLimits& limits,
                                 const std::vector<CaptureInfo>& so_far) {
  const StageTravel travel = travel_of(limits);
  std::vector<SessionPlan> list;
  const auto add = [&](Experiment e, const std::string& about) {
    if (e.captures.empty()) return;
    SessionPlan plan{e.title, about, {}, ""};
    plan.parts.push_back(std::move(e));
    list.push_back(std::move(plan));
  };
  if (std::ranges::none_of(so_far, [](const CaptureInfo& c) { return fit::is_turning(c); }))
    add(known_experiment(bench, travel, Experiment::Kind::turning),
        "No session was recorded while the stage turns.");
  std::vector<double> angles;
  for (const CaptureInfo& c : so_far)
    if (is_turn(c)) angles.push_back(c.stage_rad * fit::deg_per_rad);
  angles = different(std::move(angles), 0.005);
  const auto small_steps = [&] {
    std::size_t count = 0;
    for (std::size_t i = 1; i < angles.size(); ++i) count += angles[i] - angles[i - 1] < 1;
    return count;
  }();
  SessionPlan turned{"", "No session has looked ", {}, ""};
  const auto add_turned = [&](Experiment::Kind kind, const char* title, const char* words) {
    Experiment e = known_experiment(bench, travel, kind);
    if (e.captures.empty()) return;
    e.scans = scans_a_stop / 2;
    turned.title +=
        (turned.parts.empty() ? "" : ", and ") + std::string(turned.parts.empty() ? title : words);
    turned.about += (turned.parts.empty() ? "" : ", nor ") + std::string(words);
    turned.parts.push_back(std::move(e));
  };
  if (angles.size() - std::min(angles.size(), small_steps) < 20)
    add_turned(Experiment::Kind::all_round, "The whole scene from all stage angles", "from all stage angles");
  if (small_steps < 20)
    add_turned(Experiment::Kind::both_sides, "The whole scene in small steps of the stage",
               "in small steps of the stage");
  if (!turned.parts.empty()) {
    turned.title += ", from both sides";
    turned.about += ", from both sides.";
    list.push_back(std::move(turned));
  }
  if (!so_far.empty() && watched_s(so_far) < long_enough_s)
    list.push_back(watch("No session was long enough to see a drift."));
  if (temperatures_of(so_far).size() < 2) {
    Experiment heat = at_temperatures(bench, {18, 38});
    heat.title = "The lidar's housing at two temperatures";
    add(std::move(heat), "No session was recorded at two temperatures of the housing.");
  }
  return list;
}

SessionPlan fresh_plan(const Bench& bench, const StageLimits& limits, bool with_hand,
                       const std::vector<CaptureInfo>& so_far) {
  constexpr std::size_t stops = 8;
  const StageTravel travel = travel_of(limits);
  std::vector<double> used;
  for (const CaptureInfo& c : so_far)
    if (is_turn(c)) used.push_back(c.stage_rad * fit::deg_per_rad);
  SessionPlan plan{
      "From stage angles of no earlier session", "What it will show was written down beforehand.", {}, ""};
  plan.parts.push_back(
      turns(bench, up_and_down(farthest_from(std::move(used), travel.from_rad * fit::deg_per_rad,
                                             travel.to_rad * fit::deg_per_rad, stops))));
  std::vector<Experiment> more = {fresh_turning(bench, travel, so_far)};
  if (with_hand) {
    more.push_back(fresh_placements(bench, so_far));
    more.push_back(fresh_heat(bench, so_far));
  }
  for (Experiment& e : more)
    if (!e.captures.empty()) plan.parts.push_back(std::move(e));
  if (plan.parts.size() > 1) plan.title += ", and whatever else was examined, at other values";
  return plan;
}

std::string procedure_text(const std::string& name, const SessionPlan& plan, const Bench& bench) {
  std::string text = "procedure: " + name + "\ntitle: " + yaml_quoted(plan.title) +
                     "\nabout: " + yaml_quoted(plan.about) +
                     "\nstage: {approach: direct, margin_deg: 0.5}\nsteps:\n  - home\n";
  for (const Experiment& part : plan.parts) text += steps_text(part, bench.lidar) + put_back(part, bench);
  return text + plan.more_steps;
}

}  // namespace rig::investigate
