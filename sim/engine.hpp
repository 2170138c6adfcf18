// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "fit/bench/bench.hpp"

namespace sim {

/// Codes in place of a range (UST-10LX manual, table 3).
inline constexpr std::uint32_t too_near = 4, no_echo = 65533;

/// The operator's side of the bench, changed by prompts and by the operator port.
struct SceneState {
  std::string target;          ///< The target the following values are about.
  double target_shift_mm = 0;  ///< Along its normal, away from the axis.
  double reflectance = -1;     ///< Negative: as the bench says.
  double temperature_c = 25;
  double held_s = 0;  ///< For so long the operator held it there before confirming.
};

/// Where the bench is at one moment of simulated time.
struct StageMoment {
  double angle_rad = 0;  ///< True angle of the stage's table (the simulated stage adds its own errors).
  double rate_rad_s = 0;
};

/// Makes what a lidar would measure. Engines hold no clock and no socket; random numbers come from their
/// seed, so the same calls give the same scans.
class Engine {
 public:
  virtual ~Engine() = default;
  /// Fills one value per step. `scan_s` is the simulated time at which step 0 is passed;
  /// `stage_at` gives the stage at any later time of the scan. A range may be a code: too_near, no_echo.
  virtual void scan(double scan_s, const std::function<StageMoment(double time_s)>& stage_at,
                    std::span<std::uint32_t> range_mm, std::span<std::uint32_t> intensity) = 0;
  virtual void set_scene(const SceneState& scene) = 0;
  /// Told where the stage's drive stands when a move begins, ends or turns back. Engines with gear play and
  /// ringing need it for moves that happen between two scans; the others ignore it.
  virtual void stage_moves(double /*time_s*/, const StageMoment& /*stage*/) {}
  /// The lidar, cold, was switched on at that time. Before the first call it is so since time 0.
  virtual void switched_on(double /*time_s*/) {}
  /// The lidar begins a stream. Engines that repeat measurements (`rig-sim --repeatable`) begin their noise
  /// anew.
  virtual void begin_stream() {}
};

}  // namespace sim
