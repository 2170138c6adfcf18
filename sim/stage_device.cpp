// SPDX-License-Identifier: MIT
#include "sim/stage_device.hpp"

#include <algorithm>
#include <stdexcept>

namespace sim {

namespace stages {
std::vector<StageLanguage> all();  // Generated from the files in stages/.
}

namespace {

StageLanguage language_called(const std::string& name) {
  std::string known;
  for (const StageLanguage& language : stages::all()) {
    if (std::ranges::count(language.names, name) > 0) return language;
    for (const std::string& dialect : language.names) known += (known.empty() ? "" : ", ") + dialect;
  }
  throw std::invalid_argument("no simulated stage speaks '" + name + "': choose one of " + known);
}

}  // namespace

std::unique_ptr<StageDevice> make_stage_device(const StageDeviceOptions& options) {
  return language_called(options.language).create(options);
}

StagePhysics usual_stage_physics(const std::string& language) {
  StagePhysics physics;
  language_called(language).usual(physics);
  return physics;
}

double usual_stage_zero_deg(const std::string& language) { return language_called(language).zero_deg; }

}  // namespace sim
