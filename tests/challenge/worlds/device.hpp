// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json.hpp>

#include "session.hpp"

namespace challenge {

/// Smallest and largest echo of a session, to put thresholds where they matter.
struct PowerSpan {
  double low = 1e9, high = 0;
};
PowerSpan power_span(const Session& session);

/// Steps that any capture uses. A turning stage needs the whole scan's timing, and so does a ringing one.
struct Window {
  int first = 0, last = 1080;
};
Window window_of(const Session& session);

/// The world file of a device whose only imperfection is the counter's jitter: beams like needles, no walk
/// left, no heat.
nlohmann::json plain_world(const Session& session);

}  // namespace challenge
