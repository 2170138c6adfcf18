// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json.hpp>

#include "world.hpp"

namespace challenge {

/// Up to this incidence a session's echoes decide where thresholds are put.
constexpr double steepest_of_echoes_rad = 80 * degree;

/// Steps that any capture uses. A turning stage needs the whole scan's timing, and so does a ringing one.
struct Window {
  int first = 0, last = 1080;
};
Window window_of(const Session& session);

/// The world file of a device whose only imperfection is the counter's jitter: beams like needles, no walk
/// left, no heat.
nlohmann::json plain_world(const Session& session);

}  // namespace challenge
