// SPDX-License-Identifier: MIT
#include "rig/runner/lidar_doubts.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <nlohmann/json.hpp>

#include "rig/procedure/procedure_value.hpp"
#include "rig/session/lidar_identity.hpp"
#include "rig/text_lines.hpp"

namespace rig {
namespace {

using nlohmann::json;
using Weight = LidarDoubt::Weight;

constexpr double same_step_deg = 1e-6;

std::optional<double> parameter(const json& identity, const char* name) {
  const auto pp = identity.find("PP");
  if (pp == identity.end() || !pp->is_object() || !pp->contains(name) || !(*pp)[name].is_string())
    return std::nullopt;
  return number_in((*pp)[name].get<std::string>());
}

class Comparison {
 public:
  Comparison(const json& identity, const fit::Bench& bench)
      : identity_(identity), known_(lidar_in(identity)), bench_(bench) {}

  std::vector<LidarDoubt> run() {
    compare_state();
    compare_device();
    compare_beams();
    return std::move(doubts_);
  }

 private:
  /// Where the bench file says it, in brackets.
  [[nodiscard]] std::string place(const char* key) const {
    const auto found = bench_.lidar_places.find(key);
    if (found != bench_.lidar_places.end()) return " (" + found->second + ")";
    const auto lidar = bench_.lidar_places.find("");
    return lidar == bench_.lidar_places.end() ? "" : " (by default; " + lidar->second + ")";
  }

  void compare_state() {
    std::string state;
    if (const auto ii = identity_.find("II"); ii != identity_.end() && ii->is_object())
      state = ii->value("STAT", "");
    if (state.empty() || says_it_is_well(state)) return;
    doubts_.push_back(
        {Weight::decision, lidar_state, "it reports (STAT): " + state,
         "Switch it off and on, clean its window, consult its manual; if this persists, it needs service."});
  }

  void compare_device() {
    const fit::LidarGeometry& bench = bench_.lidar;
    if (bench_.lidar_places.contains("model") && !known_.models.empty() && !is_model(bench.model, known_))
      doubts_.push_back({Weight::decision, "model",
                         "model " + bench.model + place("model") + " where the lidar is a " + known_.name(),
                         "Correct 'model' in the bench file, or connect the lidar that it describes."});
    if (!bench.serial.empty() && !known_.serial.empty() && bench.serial != known_.serial)
      doubts_.push_back({Weight::decision, "serial number",
                         "serial " + bench.serial + place("serial") + " where the lidar has " + known_.serial,
                         "Correct 'serial' in the bench file, or connect the lidar that it is about."});
  }

  void compare_beams() {
    const fit::LidarGeometry& bench = bench_.lidar;
    const auto first = parameter(identity_, "AMIN"), last = parameter(identity_, "AMAX"),
               front = parameter(identity_, "AFRT"), turn = parameter(identity_, "ARES");
    if (last && bench.steps != *last + 1)
      differ(bench.steps > *last + 1 ? Weight::refusal : Weight::note, "steps", "steps", bench.steps,
             *last + 1);
    if (first && bench.first_step != *first)
      differ(bench.first_step < *first ? Weight::refusal : Weight::note, "first step", "first_step",
             bench.first_step, *first);
    if (front && bench.front_step != *front)
      differ(Weight::refusal, "front step", "front_step", bench.front_step, *front);
    const double step_deg = bench.step_rad * fit::deg_per_rad;
    if (turn && *turn > 0 && std::abs(step_deg - 360 / *turn) > same_step_deg)
      differ(Weight::refusal, "angle of a step", "step_deg", step_deg, 360 / *turn);
    // Turns a minute; a motor that is set by hand or runs unevenly is no other lidar.
    constexpr double same_rate = 0.1;
    const auto turns = parameter(identity_, "SCAN");
    if (turns && *turns > 0 && std::abs(bench.scan_hz / (*turns / 60) - 1) > same_rate)
      differ(Weight::refusal, "scan rate", "scan_hz", bench.scan_hz, *turns / 60);
  }

  void differ(Weight weight, const char* what, const char* key, double bench, double lidar) {
    doubts_.push_back(
        {weight, what,
         std::string(key) + " " + to_text(bench) + " where the lidar has " + to_text(lidar) + place(key),
         weight == Weight::note
             ? "Nothing, if the bench is to use a part of its beams."
             : "Correct 'lidar' in the bench file, or connect the lidar that it describes."});
  }

  const json& identity_;
  LidarIdentity known_;
  const fit::Bench& bench_;
  std::vector<LidarDoubt> doubts_;
};

}  // namespace

std::vector<LidarDoubt> doubts_of_lidar(const json& identity, const fit::Bench& bench) {
  if (!identity.is_object()) return {};
  return Comparison(identity, bench).run();
}

bool says_it_is_well(const std::string& state) {
  constexpr std::array wells{"sensor works well", "sensor is working normally", "stable"};
  std::string plain;
  for (const char c : state) plain += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return std::ranges::any_of(wells, [&](const char* well) { return plain.starts_with(well); });
}

}  // namespace rig
