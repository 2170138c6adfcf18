// SPDX-License-Identifier: MIT
#include "fit/bench/accuracy.hpp"

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "fit/mechanism.hpp"

namespace fit {
namespace {

using nlohmann::json;

struct AccuracyKey {
  const char* device;
  const char* key;
  const char* words;
  const char* unit;
  double per_unit;
  const char* mechanism;  ///< Whose first parameter has the usual size; none: nothing is assumed.
  Systematic DeviceAccuracy::*member;
};

constexpr std::array accuracy_keys = {
    AccuracyKey{"stage", "u_scale", "scale of the stage", "", 1, "stage-scale", &DeviceAccuracy::stage_scale},
    AccuracyKey{"stage", "u_eccentricity_deg", "eccentricity of the stage", "deg", rad_per_deg,
                "stage-periodic", &DeviceAccuracy::stage_eccentricity_rad},
    AccuracyKey{"stage", "u_backlash_deg", "backlash of the stage", "deg", rad_per_deg, "backlash",
                &DeviceAccuracy::stage_backlash_rad},
    AccuracyKey{"stage", "u_position_deg", "single positions of the stage", "deg", rad_per_deg, nullptr,
                &DeviceAccuracy::stage_position_rad},
    AccuracyKey{"lidar", "u_beam_eccentricity_deg", "eccentricity of the lidar's encoder", "deg", rad_per_deg,
                "encoder-eccentricity", &DeviceAccuracy::beam_eccentricity_rad},
    AccuracyKey{"lidar", "u_range_mm", "offset of the lidar's ranges", "mm", 1, "zero-offset",
                &DeviceAccuracy::range_offset_mm},
    AccuracyKey{"lidar", "u_range_scale", "scale of the lidar's ranges", "", 1, "range-scale",
                &DeviceAccuracy::range_scale},
    AccuracyKey{"lidar", "u_range_walk_mm", "range walk of the lidar on weak echoes", "mm", 1, "range-walk",
                &DeviceAccuracy::range_walk_mm}};

double usual_size(const char* mechanism) {
  const Mechanism* found = mechanism ? find_mechanism(mechanism) : nullptr;
  return found && !found->parameters.empty() ? found->parameters.front().typical : 0;
}

}  // namespace

DeviceAccuracy accuracy_of(const Bench& bench) {
  const json& document = bench.document.json();
  DeviceAccuracy out;
  for (const AccuracyKey& key : accuracy_keys) {
    out.*key.member = {usual_size(key.mechanism) * key.per_unit, false};
    const json::json_pointer place("/" + std::string(key.device) + "/accuracy/" + key.key);
    if (!document.contains(place) || !document.at(place).is_number()) continue;
    out.*key.member = {std::abs(document.at(place).get<double>()) * key.per_unit, true};
  }
  return out;
}

std::vector<AccuracyLine> accuracy_in_words(const DeviceAccuracy& accuracy) {
  std::vector<AccuracyLine> out;
  for (const AccuracyKey& key : accuracy_keys) {
    const Systematic& is = accuracy.*key.member;
    out.push_back({key.words, key.unit, is.u / key.per_unit, is.stated, key.member, key.per_unit});
  }
  return out;
}

double walk_curve(int which, double counts) {
  constexpr std::array<double, walk_curves> fades_over = {200, 500, 1200};
  return std::exp(-std::max(0.0, counts) / fades_over.at(static_cast<std::size_t>(which)));
}

}  // namespace fit
