// SPDX-License-Identifier: MIT
#include "worlds/device.hpp"

#include <algorithm>
#include <cmath>

#include "world.hpp"

namespace challenge {

using nlohmann::json;

Window window_of(const Session& session) {
  if (session.scene == "turning" || session.scene == "settle") return {};
  Window window{session.steps, 0};
  for (const Capture& capture : session.captures) {
    window.first = std::min(window.first, capture.first_step);
    window.last = std::max(window.last, capture.last_step);
  }
  return window;
}

static json pair_of(const Vector& v) { return {v.x(), v.y()}; }

json plain_world(const Session& session) {
  const Window window = window_of(session);
  json targets = json::array(), truth = json::object();
  for (std::size_t i = 0; i < session.walls.size(); ++i) {
    const Wall& wall = session.walls[i];
    // Walls of a closed room meet wherever they really stand: what sticks out is hidden behind the next one.
    const Vector beyond = wall.closed ? Vector(60 * (wall.to - wall.from).normalized()) : Vector::Zero();
    targets.push_back({{"name", wall.name},
                       {"from_mm", pair_of(wall.from - beyond)},
                       {"to_mm", pair_of(wall.to + beyond)},
                       {"reflectance", wall.reflectance}});
    truth[wall.name] = {{"offset_mm", session.truth.offset_mm[i]},
                        {"tilt_deg", session.truth.tilt_rad[i] / degree}};
  }
  const PowerSpan span = power_span(session, steepest_of_echoes_rad);
  return {{"schema", "world/1"},
          {"bench",
           {{"schema", "bench/1"},
            {"lidar",
             {{"model", "UST-10LX"},
              {"steps", window.last - window.first + 1},
              {"front_step", session.front_step - window.first},
              {"step_deg", session.step_deg},
              {"scan_hz", session.scan_hz}}},
            {"targets", targets}}},
          {"truth",
           {{"mount_x_mm", session.truth.x_mm},
            {"mount_y_mm", session.truth.y_mm},
            {"mount_yaw_deg", session.truth.yaw_rad / degree},
            {"targets", truth}}},
          {"beam", {{"long_mrad", 0}, {"short_mrad", 0}, {"aperture_mm", 0}}},
          {"receiver",
           {{"threshold", 0.2 * span.low},
            {"noise", 0},
            {"overlap_mm", 80},
            {"counts_exponent", session.radiometer.exponent},
            {"counts_noise", session.claims_intensity ? session.counts_noise : 0.0}}},
          {"counter", {{"jitter_ns", session.sigma_mm / light_mm_per_ns}}},
          {"rotor", {{"rolling", false}}},
          {"heat", {{"rise_fast_k", 0}, {"rise_slow_k", 0}, {"slow_s", 1}}}};
}

}  // namespace challenge
