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

namespace {

double cross(const Vector& a, const Vector& b) { return a.x() * b.y() - a.y() * b.x(); }

/// A wall's ends, and its offset, so that turned about its new middle it lies on the same line.
struct Drawn {
  Vector from, to;
  double offset_mm;
};

/// Walls of a closed room meet wherever they really stand. Past an inner corner what sticks out is hidden
/// behind the next one; at an outward corner it would be seen.
Drawn drawn(const Session& session, const std::vector<Segment>& walls, std::size_t i,
            const std::vector<std::size_t>& outline, bool ccw) {
  constexpr double beyond_mm = 60;
  const auto stated = [&](std::size_t k) {
    return Vector((session.walls[k].to - session.walls[k].from).normalized());
  };
  const Segment& own = walls[i];
  double first = 0, last = own.length;
  if (own.closed) {
    const auto k = static_cast<std::size_t>(std::ranges::find(outline, i) - outline.begin());
    const std::size_t n = outline.size(), before = outline[(k + n - 1) % n], after = outline[(k + 1) % n];
    const auto is_inner = [&](std::size_t a, std::size_t b) {
      return (cross(stated(a), stated(b)) > 0) == ccw;
    };
    first = is_inner(before, i) ? -beyond_mm : own.first_mm;
    last = is_inner(i, after) ? own.length + beyond_mm : own.last_mm;
  }
  const double middle = (first + last - own.length) / 2, half = (last - first) / 2,
               turn_rad = session.truth.tilt_rad[i];
  const Vector along = stated(i), left(-along.y(), along.x()),
               at = (session.walls[i].from + session.walls[i].to) / 2 + middle * std::cos(turn_rad) * along;
  return {at - half * along, at + half * along,
          session.truth.offset_mm[i] + middle * std::sin(turn_rad) * left.dot(own.outward)};
}

}  // namespace

json plain_world(const Session& session) {
  const Window window = window_of(session);
  json targets = json::array(), truth = json::object();
  const std::vector<Segment> standing = standing_walls(session, session.truth);
  std::vector<std::size_t> outline;
  double area = 0;
  for (std::size_t i = 0; i < session.walls.size(); ++i) {
    if (!session.walls[i].closed) continue;
    outline.push_back(i);
    area += cross(session.walls[i].from, session.walls[i].to);
  }
  for (std::size_t i = 0; i < session.walls.size(); ++i) {
    const Wall& wall = session.walls[i];
    const Drawn ends = drawn(session, standing, i, outline, area > 0);
    targets.push_back({{"name", wall.name},
                       {"from_mm", pair_of(ends.from)},
                       {"to_mm", pair_of(ends.to)},
                       {"reflectance", wall.reflectance}});
    truth[wall.name] = {{"offset_mm", ends.offset_mm}, {"tilt_deg", session.truth.tilt_rad[i] / degree}};
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
