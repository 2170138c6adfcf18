// SPDX-License-Identifier: MIT
#include "rig/runner/placed_bench.hpp"

#include <nlohmann/json.hpp>

#include "rig/runner/target_detection.hpp"

namespace rig {
namespace {

std::optional<double> number_if_any(const nlohmann::json& object, const char* key) {
  if (!object.contains(key) || !object[key].is_number()) return std::nullopt;
  return object[key].get<double>();
}

}  // namespace

void PlacedBench::place(const Placement& placement, std::int64_t now_us) {
  Placement& known = placements_[placement.target];
  known.target = placement.target;
  if (placement.shift_mm) known.shift_mm = placement.shift_mm;
  if (placement.reflectance) known.reflectance = placement.reflectance;
  if (placement.temperature_c) placements_[""].temperature_c = placement.temperature_c;
  if (placement.since_power_on_s)
    power_on_us_ = now_us - static_cast<std::int64_t>(1e6 * *placement.since_power_on_s);
}

nlohmann::json PlacedBench::placements_json() const {
  nlohmann::json all = nlohmann::json::array();
  for (const auto& [target, placement] : placements_) {
    nlohmann::json each = {{"target", placement.target}};
    if (placement.shift_mm) each["shift_mm"] = *placement.shift_mm;
    if (placement.reflectance) each["reflectance"] = *placement.reflectance;
    if (placement.temperature_c) each["temperature_c"] = *placement.temperature_c;
    all.push_back(std::move(each));
  }
  return all;
}

void PlacedBench::restore(const nlohmann::json& placements, const nlohmann::json& power_on_us) {
  if (power_on_us.is_number_integer()) power_on_us_ = power_on_us.get<std::int64_t>();
  if (!placements.is_array()) return;
  for (const nlohmann::json& each : placements) {
    Placement placement;
    placement.target = each.value("target", "");
    placement.shift_mm = number_if_any(each, "shift_mm");
    placement.reflectance = number_if_any(each, "reflectance");
    placement.temperature_c = number_if_any(each, "temperature_c");
    placements_[placement.target] = placement;
  }
}

fit::Target PlacedBench::as_placed(const fit::Target& target) const {
  const auto known = placements_.find(target.name);
  if (known == placements_.end()) return target;
  fit::Target placed = shifted(target, known->second.shift_mm.value_or(0));
  if (known->second.reflectance) placed.reflectance = known->second.reflectance;
  return placed;
}

std::vector<std::string> PlacedBench::moved_beside(const std::optional<std::string>& target) const {
  std::vector<std::string> moved;
  for (const auto& [name, placement] : placements_)
    if (name != target && placement.shift_mm.value_or(0) != 0) moved.push_back(name);
  return moved;
}

void PlacedBench::describe(fit::CaptureInfo& capture) const {
  if (const auto moved = moved_beside({}); !capture.target && moved.size() == 1)
    capture.target = moved.front();
  if (capture.target)
    if (const auto placed = placements_.find(*capture.target); placed != placements_.end()) {
      capture.target_shift_mm = placed->second.shift_mm.value_or(0);
      capture.reflectance = placed->second.reflectance;
    }
  if (const auto air = placements_.find(""); air != placements_.end())
    capture.temperature_c = air->second.temperature_c;
  if (power_on_us_) capture.since_power_on_s = static_cast<double>(capture.started_us - *power_on_us_) * 1e-6;
}

}  // namespace rig
