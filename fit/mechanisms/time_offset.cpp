// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Stage or odometry time stamps are late by a constant (stamps come on 1 or 5 ms frames:
// seqsense/urg_stamped).
Mechanism make_time_offset() {
  Mechanism m;
  m.id = "time-offset";
  m.cause = "the stage's time stamps are late or early against the lidar's";
  m.coordinate = Coordinate::stage_rate;
  m.geometric = true;
  m.formula_error = 0.02;
  m.parameters = {{.name = "offset_ms", .typical = 15}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.stage_rad = p[0] / 1000 * c.stage_rate_rad_s};
  };
  m.says = [](const Finding& f) {
    return "The stage's time stamps are off by " + with_uncertainty(f.at("offset_ms"), "ms") +
           ": the angle error is proportional to the rate and changes sign with it.";
  };
  m.separate = "turn at two rates, both ways";
  return m;
}

}  // namespace fit::mechanisms
