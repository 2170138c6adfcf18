// SPDX-License-Identifier: MIT
#pragma once

#include "fit/bench/bench.hpp"
#include "sim/stage_device.hpp"

namespace sim {

/// The stage that a bench file describes: language, address, units_per_deg, speed, ends, and under `physics`
/// the causes of its errors by the names of StagePhysics' members (docs/develop/simulator.md). What is not
/// said is as usual for the language. Throws std::invalid_argument naming the key.
StageDeviceOptions stage_device_options(const fit::Bench& bench, const std::string& language_override = "");

/// How the bench's angles lie on the stage's own scale.
struct StageFrame {
  int direction = 1;    ///< -1: the stage counts clockwise.
  double zero_deg = 0;  ///< The bench's zero, on the stage's scale.
  [[nodiscard]] StageMoment on_bench(const StageMoment& on_stage) const;
};

StageFrame stage_frame(const fit::Bench& bench, const std::string& language_override = "");

}  // namespace sim
