// SPDX-License-Identifier: MIT
#include "fit/bench/empirical.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "fit/numeric/linear_table.hpp"

namespace fit {
namespace {

using nlohmann::json;

/// What a table is added to.
struct NamedAct {
  const char* name;
  Observable observable;
  bool geometric;
  Effect (*by)(double value, const Circumstances& at);
};

constexpr std::array acts{
    NamedAct{"range_mm", Observable::range_mean, false,
             [](double y, const Circumstances&) { return Effect{.range_mm = y}; }},
    NamedAct{"range_mm_per_m", Observable::range_mean, false,
             [](double y, const Circumstances& at) { return Effect{.range_mm = y * at.range_mm / 1000}; }},
    NamedAct{"beam_angle_deg", Observable::range_mean, true,
             [](double y, const Circumstances&) { return Effect{.beam_rad = y * rad_per_deg}; }},
    NamedAct{"stage_angle_deg", Observable::range_mean, true,
             [](double y, const Circumstances&) { return Effect{.stage_rad = y * rad_per_deg}; }},
    NamedAct{"log_intensity", Observable::intensity, false,
             [](double y, const Circumstances&) { return Effect{.log_intensity = y}; }},
    NamedAct{"far_share", Observable::range_mean, false,
             [](double, const Circumstances&) { return Effect{}; }}};

struct NamedCoordinate {
  const char* name;
  Coordinate coordinate;
  double (*of)(const Circumstances&);
};

constexpr std::array coordinates{
    NamedCoordinate{"beam_deg", Coordinate::beam,
                    [](const Circumstances& c) { return c.beam_rad * deg_per_rad; }},
    NamedCoordinate{"stage_deg", Coordinate::stage,
                    [](const Circumstances& c) { return c.stage_rad * deg_per_rad; }},
    NamedCoordinate{"range_mm", Coordinate::range, [](const Circumstances& c) { return c.range_mm; }},
    NamedCoordinate{"intensity", Coordinate::intensity, [](const Circumstances& c) { return c.intensity; }},
    NamedCoordinate{"incidence_deg", Coordinate::incidence,
                    [](const Circumstances& c) { return c.incidence_rad * deg_per_rad; }},
    NamedCoordinate{"time_s", Coordinate::time, [](const Circumstances& c) { return c.time_s; }},
    NamedCoordinate{"temperature_c", Coordinate::temperature,
                    [](const Circumstances& c) { return c.temperature_k; }},
    NamedCoordinate{"corner_mm", Coordinate::target, [](const Circumstances& c) { return c.corner_mm; }},
    NamedCoordinate{"edge_distance_deg", Coordinate::edge_distance,
                    [](const Circumstances& c) { return c.edge_rad * deg_per_rad; }},
    NamedCoordinate{"along_mm", Coordinate::target, [](const Circumstances& c) { return c.along_mm; }}};

const NamedCoordinate* named(const std::string& name) {
  const auto found = std::ranges::find(coordinates, name, &NamedCoordinate::name);
  return found == coordinates.end() ? nullptr : &*found;
}

[[noreturn]] void refuse(const std::string& complaint) {
  throw std::invalid_argument("the bench file's \"empirical\" " + complaint);
}

EmpiricalFunction function_of(const json& entry) {
  EmpiricalFunction f;
  if (!entry.is_object() || !entry.contains("coordinate") || !entry["coordinate"].is_string() ||
      !named(entry["coordinate"].get<std::string>()))
    refuse("needs a \"coordinate\", one of beam_deg, stage_deg, range_mm, intensity and others");
  f.coordinate = entry["coordinate"].get<std::string>();
  if (entry.contains("target")) {
    if (!entry["target"].is_string()) refuse("names a \"target\" that is not text");
    f.target = entry["target"].get<std::string>();
  }
  const auto numbers = [&](const char* key) {
    std::vector<double> list;
    if (!entry.contains(key) || !entry[key].is_array()) refuse(std::string("needs the list \"") + key + "\"");
    for (const json& number : entry[key]) {
      if (!number.is_number()) refuse(std::string("holds what is not a number in \"") + key + "\"");
      list.push_back(number.get<double>());
    }
    return list;
  };
  f.at = numbers("at");
  for (const NamedAct& act : acts)
    if (entry.contains(act.name)) f.acts_on = act.name;
  if (f.acts_on.empty())
    refuse(
        "needs one of range_mm, range_mm_per_m, beam_angle_deg, stage_angle_deg, log_intensity: what it is "
        "added to");
  f.value = numbers(f.acts_on.c_str());
  if (f.at.size() != f.value.size() || !std::ranges::is_sorted(f.at))
    refuse("needs as many values as places, and places in rising order");
  return f;
}

}  // namespace

double EmpiricalFunction::value_at(double v) const {
  if (at.empty() || !std::isfinite(v)) return 0;
  if (at.size() == 1) return v == at.front() ? value.front() : 0;
  const std::size_t last = at.size() - 1;
  if (v <= at.front()) return at.front() - v <= at[1] - at[0] ? value.front() : 0;
  if (v >= at.back()) return v - at.back() <= at[last] - at[last - 1] ? value.back() : 0;
  return linear_in(at, value, v);
}

bool EmpiricalFunction::covers(double v) const {
  constexpr double widest_gap = 0.1, rounding = 1e-6;  // of the span
  if (at.empty() || !std::isfinite(v)) return false;
  constexpr double none = std::numeric_limits<double>::infinity();
  const auto next = std::ranges::lower_bound(at, v);
  const double span = at.back() - at.front(), above = next == at.end() ? none : *next - v,
               below = next == at.begin() ? none : v - *(next - 1);
  return above + below <= widest_gap * span || std::min(above, below) <= rounding * span;
}

double EmpiricalFunction::place_of(const Circumstances& there) const { return named(coordinate)->of(there); }

std::vector<EmpiricalFunction> empirical_functions(const Bench& bench) {
  std::vector<EmpiricalFunction> list;
  const json& document = bench.document.json();
  if (!document.contains("empirical")) return list;
  if (!document["empirical"].is_array()) refuse("must be a list [...]");
  for (const json& entry : document["empirical"]) list.push_back(function_of(entry));
  return list;
}

json as_entry(const EmpiricalFunction& f) {
  json entry{{"coordinate", f.coordinate}, {"at", f.at}, {f.acts_on, f.value}};
  if (!f.target.empty()) entry["target"] = f.target;
  return entry;
}

void add_empirical(Bench& bench, const EmpiricalFunction& f) {
  if (f.at.empty()) return;
  bench.document.change([&](json& document) { document["empirical"].push_back(as_entry(f)); });
}

void keep_targets(Bench& bench, std::size_t count) {
  bench.targets.resize(count);
  const auto is_elsewhere = [&](const std::string& target) {
    return !target.empty() && !bench.target(target);
  };
  std::erase_if(bench.known, [&](const KnownMechanism& known) {
    const auto target = known.texts.find("target");
    return target != known.texts.end() && is_elsewhere(target->second);
  });
  if (!bench.document.json().contains("empirical")) return;
  json kept = json::array();
  for (const json& entry : bench.document.json()["empirical"])
    if (!is_elsewhere(function_of(entry).target)) kept.push_back(entry);
  bench.document.change([&](json& document) { document["empirical"] = kept; });
}

Mechanism as_mechanism(const EmpiricalFunction& f, const Bench& bench) {
  const NamedCoordinate& along = *named(f.coordinate);
  Mechanism m;
  m.id = "empirical";
  m.cause = "what was measured and has no name";
  m.coordinate = along.coordinate;
  m.formula_error = 0;
  int target = -1;
  if (!f.target.empty()) {
    const auto found = std::ranges::find(bench.targets, f.target, &Target::name);
    if (found == bench.targets.end())
      refuse("acts on a target \"" + f.target + "\", which is not among the bench's");
    target = static_cast<int>(found - bench.targets.begin());
  }
  const NamedAct& act = *std::ranges::find(acts, f.acts_on, &NamedAct::name);
  m.observable = act.observable;
  m.geometric = act.geometric;
  m.act = [f, target, by = act.by, of = along.of](const Circumstances& c, std::span<const double>) {
    if (target >= 0 && c.target != target) return Effect{};
    return by(f.value_at(of(c)), c);
  };
  m.says = [](const Finding&) { return std::string("It was measured, and has no name."); };
  return m;
}

bool moves_or_dims(const EmpiricalFunction& f) { return f.acts_on != "far_share"; }

namespace {

/// The section `sim` of a bench's document; an empty object without.
const json& simulation_of(const Bench& bench) { return bench.document.section("sim"); }

void state(Bench& bench, const char* key, const json& value) {
  bench.document.change([&](json& document) { document["sim"][key] = value; });
}

}  // namespace

std::optional<double> described_merging(const Bench& bench) {
  const json sim = simulation_of(bench);
  if (!sim.contains("merging_mm") || !sim["merging_mm"].is_number()) return {};
  return sim["merging_mm"].get<double>();
}

void state_merging(Bench& bench, double merging_mm) { state(bench, "merging_mm", merging_mm); }

double StrayPlaces::range_mm(double probability, double target_mm) const {
  const double at = std::clamp(probability, 0.0, 1.0) * static_cast<double>(quantiles.size() - 1);
  const auto i = std::min(quantiles.size() - 2, static_cast<std::size_t>(at));
  const double value = quantiles[i] + (at - static_cast<double>(i)) * (quantiles[i + 1] - quantiles[i]);
  return before_target ? value * target_mm : value;
}

std::optional<StrayPlaces> described_strays(const Bench& bench) {
  const json sim = simulation_of(bench);
  if (!sim.contains("strays") || !sim["strays"].is_object()) return {};
  StrayPlaces strays;
  strays.before_target = sim["strays"].contains("of_target");
  const json list = sim["strays"].value(strays.before_target ? "of_target" : "range_mm", json());
  if (!list.is_array()) return {};
  for (const json& number : list)
    if (number.is_number()) strays.quantiles.push_back(number.get<double>());
  if (strays.quantiles.size() < 2 || !std::ranges::is_sorted(strays.quantiles)) return {};
  return strays;
}

void state_strays(Bench& bench, const StrayPlaces& strays) {
  state(bench, "strays", json{{strays.before_target ? "of_target" : "range_mm", strays.quantiles}});
}

}  // namespace fit
