// SPDX-License-Identifier: MIT
#pragma once

#include "fit/bench.hpp"
#include "sim/stage_device.hpp"

namespace sim {

/// The stage that a bench file describes: language, address, units_per_deg, speed, ends, and under `physics`
/// the causes of its errors by the names of StagePhysics' members (docs/simulator.md). What is not said is as
/// usual for the language. Throws std::invalid_argument naming the key.
StageDeviceOptions stage_device_options(const fit::Bench& bench, const std::string& language_override = "");

/// +1, or -1 if the stage counts clockwise.
int stage_direction(const fit::Bench& bench);

}  // namespace sim
