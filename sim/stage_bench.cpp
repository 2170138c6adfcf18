// SPDX-License-Identifier: MIT
#include "sim/stage_bench.hpp"

#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace sim {

namespace {

using nlohmann::json;

double number(const std::string& key, const json& value) {
  if (!value.is_number())
    throw std::invalid_argument("the bench file's stage." + key + " is " + value.dump() +
                                ", but must be a number");
  return value.get<double>();
}

const std::map<std::string, double StagePhysics::*> members{
    {"units_per_deg", &StagePhysics::units_per_deg},
    {"speed_deg_s", &StagePhysics::speed_deg_s},
    {"acceleration_deg_s2", &StagePhysics::acceleration_deg_s2},
    {"homing_speed_deg_s", &StagePhysics::homing_speed_deg_s},
    {"min_deg", &StagePhysics::min_deg},
    {"max_deg", &StagePhysics::max_deg},
    {"power_on_deg", &StagePhysics::power_on_deg},
    {"backlash_deg", &StagePhysics::backlash_deg},
    {"worm_deg", &StagePhysics::worm_deg},
    {"worm_teeth", &StagePhysics::worm_teeth},
    {"worm_phase_deg", &StagePhysics::worm_phase_deg},
    {"wheel_deg", &StagePhysics::wheel_deg},
    {"wheel_phase_deg", &StagePhysics::wheel_phase_deg},
    {"scale", &StagePhysics::scale},
    {"motor_deg", &StagePhysics::motor_deg},
    {"full_step_deg", &StagePhysics::full_step_deg},
    {"spring_hz", &StagePhysics::spring_hz},
    {"spring_damping", &StagePhysics::spring_damping},
    {"creep_deg", &StagePhysics::creep_deg},
    {"creep_s", &StagePhysics::creep_s},
};

void set_physics(StagePhysics& physics, const json& causes) {
  if (!causes.is_object()) throw std::invalid_argument("the bench file's stage.physics must be an object");
  for (const auto& [key, value] : causes.items()) {
    const auto member = members.find(key);
    if (member == members.end()) {
      std::string known;
      for (const auto& [name, unused] : members) known += (known.empty() ? "" : ", ") + name;
      throw std::invalid_argument("the bench file's stage.physics has no '" + key + "'; it has " + known);
    }
    physics.*(member->second) = number("physics." + key, value);
  }
}

/// What is known of a stage by its name (docs/operate/stages.md gives the sources).
void set_model(StagePhysics& physics, const std::string& model, const std::string& language) {
  const bool is_sigma_koki = language == "shot" || language == "gsc";
  if (language == "zaber" && model == "X-RSW60A") physics.units_per_deg = 1536000.0 / 360;
  if (language == "zaber" && model == "X-RSW60C") physics.units_per_deg = 384000.0 / 360;
  if (is_sigma_koki && (model == "OSMS-40YAW" || model == "OSMS-60YAW")) {
    physics.min_deg = -2.5;  // A hard stop clockwise; the other way it turns without end.
    physics.backlash_deg = 0.1;
  }
}

/// Speed and units are the operator's as well as the device's.
void set_common(StagePhysics& physics, const json& stage) {
  for (const char* key : {"units_per_deg", "speed_deg_s", "acceleration_deg_s2"})
    if (stage.contains(key)) physics.*(members.at(key)) = number(key, stage[key]);
  if (stage.contains("units_per_turn"))
    physics.units_per_deg = number("units_per_turn", stage["units_per_turn"]) / 360;
  if (!(physics.units_per_deg > 0) || !(physics.speed_deg_s > 0) || !(physics.acceleration_deg_s2 > 0))
    throw std::invalid_argument(
        "the bench file's stage: units_per_deg, speed_deg_s and acceleration_deg_s2 must be above 0");
}

json stage_of(const fit::Bench& bench) {
  json stage = bench.document.json().value("stage", json::object());
  if (!stage.is_object()) throw std::invalid_argument("the bench file's stage must be an object");
  return stage;
}

std::string text(const json& stage, const std::string& key, const std::string& otherwise) {
  if (!stage.contains(key)) return otherwise;
  if (!stage[key].is_string())
    throw std::invalid_argument("the bench file's stage." + key + " must be a text");
  return stage[key].get<std::string>();
}

}  // namespace

StageDeviceOptions stage_device_options(const fit::Bench& bench, const std::string& language_override) {
  const json stage = stage_of(bench);
  StageDeviceOptions options;
  options.language = language_override.empty() ? text(stage, "language", "zaber") : language_override;
  options.physics = usual_stage_physics(options.language);
  set_model(options.physics, text(stage, "model", ""), options.language);
  set_common(options.physics, stage);
  if (stage.contains("physics")) set_physics(options.physics, stage["physics"]);
  if (stage.contains("address")) options.address = static_cast<int>(number("address", stage["address"]));
  if (stage.contains("homed")) options.homed = stage["homed"] == true;
  if (stage.contains("axes")) options.axes = static_cast<int>(number("axes", stage["axes"]));
  if (stage.contains("acknowledges")) options.acknowledges = stage["acknowledges"] == true;
  return options;
}

StageFrame stage_frame(const fit::Bench& bench, const std::string& language_override) {
  const json stage = stage_of(bench);
  StageFrame frame;
  if (stage.contains("direction") && number("direction", stage["direction"]) < 0) frame.direction = -1;
  const std::string language =
      language_override.empty() ? text(stage, "language", "zaber") : language_override;
  frame.zero_deg =
      stage.contains("zero_deg") ? number("zero_deg", stage["zero_deg"]) : usual_stage_zero_deg(language);
  return frame;
}

StageMoment StageFrame::on_bench(const StageMoment& on_stage) const {
  return {direction * (on_stage.angle_rad - zero_deg * fit::rad_per_deg), direction * on_stage.rate_rad_s};
}

}  // namespace sim
