// SPDX-License-Identifier: MIT
#include "rig/archive/fleet.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "fit/numeric/number_format.hpp"
#include "rig/archive/history.hpp"
#include "rig/archive/middle.hpp"
#include "rig/archive/swapped.hpp"
#include "rig/archive/unknown_shapes.hpp"

namespace rig {
namespace {

using nlohmann::json;

constexpr double false_drifts = 0.01;  // Of those that are reported.

/// Years since the first calibration of the lidar in the archive, in whole ones: 0 is the first year.
std::map<const SessionRecord*, int> ages_of(std::span<const SessionRecord> archive) {
  std::map<std::string, double> first;
  for (const SessionRecord& r : archive)
    if (const auto s = seconds_of_utc(r.measured_utc))
      if (const auto known = first.emplace(r.serial, *s); !known.second)
        known.first->second = std::min(known.first->second, *s);
  std::map<const SessionRecord*, int> out;
  for (const SessionRecord& r : archive)
    if (const auto s = seconds_of_utc(r.measured_utc))
      out[&r] = static_cast<int>((*s - first[r.serial]) / seconds_a_year);
  return out;
}

struct Named {
  std::set<const SessionRecord*> sessions;
  std::set<std::string> serials;
  double least_probability = 1;
  /// Sizes by parameter, model and age.
  std::map<std::string, std::map<std::pair<std::string, int>, std::vector<double>>> sizes;
};

json sizes_json(const Named& named) {
  json out = json::array();
  for (const auto& [parameter, groups] : named.sizes)
    for (const auto& [group, values] : groups) {
      std::vector<double> sorted = values;
      std::ranges::sort(sorted);
      out.push_back({{"parameter", parameter},
                     {"model", group.first},
                     {"age_years", group.second},
                     {"sessions", sorted.size()},
                     {"median", middle_of(sorted)},
                     {"least", sorted.front()},
                     {"most", sorted.back()}});
    }
  return out;
}

json mechanisms_of(std::span<const SessionRecord> archive) {
  const auto ages = ages_of(archive);
  std::map<std::string, Named> all;
  for (const SessionRecord& r : archive) {
    if (!r.explanation) continue;
    for (const ArchivedMechanism& m : r.explanation->mechanisms) {
      Named& named = all[m.mechanism];
      named.sessions.insert(&r);
      named.serials.insert(r.serial);
      named.least_probability = std::min(named.least_probability, m.probability);
      const auto age = ages.find(&r);
      for (const auto& [parameter, estimate] : m.parameters)
        named.sizes[parameter][{r.model, age == ages.end() ? 0 : age->second}].push_back(estimate.value);
    }
  }
  json out = json::array();
  for (const auto& [name, named] : all)
    out.push_back({{"mechanism", name},
                   {"sessions", named.sessions.size()},
                   {"lidars", named.serials.size()},
                   {"serials", named.serials},
                   {"least_probability", named.least_probability},
                   {"sizes", sizes_json(named)}});
  std::stable_sort(out.begin(), out.end(), [](const json& a, const json& b) {
    return a.at("sessions").get<std::size_t>() > b.at("sessions").get<std::size_t>();
  });
  return out;
}

json undecided_of(std::span<const SessionRecord> archive) {
  std::map<std::string, std::pair<std::size_t, std::set<std::string>>> all;
  for (const SessionRecord& r : archive)
    if (r.explanation)
      for (const std::string& set : r.explanation->undecided) {
        ++all[set].first;
        all[set].second.insert(r.serial);
      }
  json out = json::array();
  for (const auto& [set, seen] : all)
    out.push_back({{"between", set},
                   {"sessions", seen.first},
                   {"lidars", seen.second.size()},
                   {"serials", seen.second}});
  std::stable_sort(out.begin(), out.end(), [](const json& a, const json& b) {
    return a.at("sessions").get<std::size_t>() > b.at("sessions").get<std::size_t>();
  });
  return out;
}

json unknown_of(std::span<const SessionRecord> archive) {
  json out = json::array();
  for (const UnknownShape& shape : unknown_shapes(archive)) {
    json paths = json::array();
    for (const SessionRecord* s : shape.sessions) paths.push_back(s->path);
    const auto serials = shape.serials();
    out.push_back({{"coordinate", shape.coordinate},
                   {"observable", shape.observable},
                   {"form", shape.form},
                   {"channel", shape.channel},
                   {"size", shape.size},
                   {"lidars", serials.size()},
                   {"serials", serials},
                   {"sessions", paths},
                   {"typical", shape.sessions.front()->path},
                   {"describes", shape.sessions.front()->explanation->unknown_describes},
                   {"at", shape.at},
                   {"curve", shape.curve}});
  }
  return out;
}

/// The drift that all lidars have in common is the bench's: the median slope of a quantity, with the
/// uncertainty of a median. A lidar drifts by what it does beside that.
struct CommonDrift {
  double per_year = 0, u = 0;
  std::size_t lidars = 0;
};

CommonDrift common_of(std::vector<double> slopes) {
  CommonDrift out;
  out.lidars = slopes.size();
  if (slopes.size() < 5) return out;
  out.per_year = middle_of(slopes);
  std::vector<double> away;
  for (const double s : slopes) away.push_back(std::abs(s - out.per_year));
  out.u = 1.2533 * 1.4826 * middle_of(away) / std::sqrt(static_cast<double>(slopes.size()));
  return out;
}

void add_drifts(json& fleet, std::span<const QuantityHistory> histories,
                const std::map<std::string, Repeatability>& repeat) {
  std::vector<const QuantityHistory*> with_line;
  std::vector<Drift> drifts;
  std::vector<double> p_values;
  std::map<std::string, std::vector<double>> slopes;
  for (const QuantityHistory& h : histories) {
    const Drift drift = drift_of(h, repeat);
    if (drift.degrees_of_freedom <= 0) continue;
    with_line.push_back(&h);
    drifts.push_back(drift);
    p_values.push_back(drift.p_value);
    slopes[h.model + "/" + h.quantity].push_back(drift.per_year);
  }
  const std::vector<bool> found = found_at_rate(p_values, false_drifts);
  fleet["drifts"] = fleet["common_drifts"] = json::array();
  for (std::size_t i = 0; i < with_line.size(); ++i) {
    if (!found[i]) continue;
    const QuantityHistory& h = *with_line[i];
    const CommonDrift common = common_of(slopes[h.model + "/" + h.quantity]);
    fleet["drifts"].push_back({{"serial", h.serial},
                               {"model", h.model},
                               {"quantity", h.quantity},
                               {"label", h.label},
                               {"unit", h.unit},
                               {"per_year", drifts[i].per_year},
                               {"U", drifts[i].expanded},
                               {"p_value", drifts[i].p_value},
                               {"common_per_year", common.per_year},
                               {"calibrations", h.points.size() - h.since_adjustment()}});
  }
  fleet["drifts_looked_at"] = with_line.size();
  for (const auto& [key, list] : slopes) {
    const CommonDrift common = common_of(list);
    // Three standard uncertainties: as many quantities are looked at as there are.
    if (common.u > 0 && std::abs(common.per_year) > 3 * common.u)
      fleet["common_drifts"].push_back({{"model", key.substr(0, key.find('/'))},
                                        {"quantity", key.substr(key.find('/') + 1)},
                                        {"per_year", common.per_year},
                                        {"U", 2 * common.u},
                                        {"lidars", common.lidars}});
  }
  std::stable_sort(fleet["drifts"].begin(), fleet["drifts"].end(), [](const json& a, const json& b) {
    return a.at("p_value").get<double>() < b.at("p_value").get<double>();
  });
}

/// A lidar that drifts leaves its own results by itself: its sessions are reported there.
json strange_of(std::span<const SessionRecord> archive, std::span<const QuantityHistory> histories,
                const std::map<std::string, Repeatability>& repeat) {
  json out = json::array();
  for (const StrangeSession& s : strange_sessions(archive, histories, repeat))
    out.push_back(
        {{"session", s.session->path},
         {"serial", s.session->serial},
         {"measured_utc", s.session->measured_utc},
         {"looks_like", s.looks_like},
         {"also_like", s.also_like},
         {"chi_squared", s.distance},
         {"chi_squared_of_other", std::isfinite(s.distance_to_other) ? json(s.distance_to_other) : json()},
         {"quantities", s.quantities},
         {"p_value", s.p_value}});
  return out;
}

json repeatability_json(const std::map<std::string, Repeatability>& repeat) {
  json out = json::array();
  for (const auto& [key, r] : repeat)
    out.push_back({{"model", key.substr(0, key.find('/'))},
                   {"quantity", key.substr(key.find('/') + 1)},
                   {"sigma", r.sigma},
                   {"differences", r.differences},
                   {"enough", r.differences >= enough_differences}});
  return out;
}

}  // namespace

json fleet_of(std::span<const SessionRecord> archive) {
  std::map<std::string, std::set<std::string>> models;
  std::map<std::string, std::size_t> verdicts;
  std::string first, last;
  std::size_t without_serial = 0;
  for (const SessionRecord& r : archive) {
    if (r.serial.empty())
      ++without_serial;
    else
      models[r.model].insert(r.serial);
    ++verdicts[r.explanation ? r.explanation->verdict : "not explained"];
    if (r.measured_utc.empty()) continue;
    if (first.empty() || r.measured_utc < first) first = r.measured_utc;
    last = std::max(last, r.measured_utc);
  }
  json fleet = {{"schema", "fleet/1"},    {"sessions", archive.size()},       {"first_utc", first},
                {"last_utc", last},       {"without_serial", without_serial}, {"verdicts", verdicts},
                {"models", json::array()}};
  for (const auto& [model, serials] : models)
    fleet["models"].push_back({{"model", model}, {"lidars", serials.size()}});
  fleet["simulated"] = std::ranges::any_of(archive, &SessionRecord::simulated);
  fleet["mechanisms"] = mechanisms_of(archive);
  fleet["undecided"] = undecided_of(archive);
  fleet["unknown"] = unknown_of(archive);
  const auto histories = histories_of(archive);
  const auto repeat = repeatabilities_of(histories);
  add_drifts(fleet, histories, repeat);
  fleet["strange"] = strange_of(archive, histories, repeat);
  fleet["repeatability"] = repeatability_json(repeat);
  return fleet;
}

}  // namespace rig
