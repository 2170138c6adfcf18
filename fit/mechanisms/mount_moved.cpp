// SPDX-License-Identifier: MIT
#include "fit/on_stage.hpp"

namespace fit::mechanisms {

// Somebody knocked against the lidar, or a screw gave way: from then on it sits elsewhere on the stage.
Mechanism make_mount_moved() {
  Mechanism m;
  m.id = "mount-moved";
  m.cause = "the lidar was moved on the stage while the session was recorded";
  m.coordinate = Coordinate::time;
  m.geometric = true;
  m.formula_error = 0.01;
  m.parameters = {
      {.name = "x_mm", .typical = 3, .largest = 100},
      {.name = "y_mm", .typical = 3, .largest = 100},
      {.name = "yaw_deg", .typical = 0.3, .largest = 20},
      {.name = "from_s", .role = Parameter::Role::shape, .scale = Parameter::Scale::moment, .upper = 1e8}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    if (c.clock_s < p[3]) return Effect{};
    return Effect{.beam_rad = p[2] * rad_per_deg, .origin_mm = on_stage_mm(c, p[0], p[1])};
  };
  m.looks_like = {"target-moved", "warm-up"};  // before one target
  m.shows = [](const Finding& f, const Recorded& r) {
    return std::vector<Interval>{{Coordinate::time, f.at("from_s").value, r.to}};
  };
  m.says = [](const Finding& f) {
    return "Some " + rounded(f.at("from_s").value) +
           " s after power-on the lidar was moved on the stage by " + with_uncertainty(f.at("x_mm"), "mm") +
           " / " + with_uncertainty(f.at("y_mm"), "mm") + " (x / y) and turned by " +
           with_uncertainty(f.at("yaw_deg"), "deg") + ". Fasten it, and record the session again.";
  };
  m.separate = "look at the first stop again: a lidar that was moved reads otherwise there than it did";
  return m;
}

}  // namespace fit::mechanisms
