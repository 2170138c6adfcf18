// SPDX-License-Identifier: MIT
#include <algorithm>

#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// A table on a springy shaft rings after a move: towards where it came from, or, where a load pulls it,
// always to the same side.
Mechanism make_settling() {
  Mechanism m;
  m.id = "settling";
  m.cause = "the stage still rings or creeps when the first scans of a capture are taken";
  m.coordinate = Coordinate::scan_seq;
  m.geometric = true;
  m.parameters = {{.name = "amplitude_deg", .typical = 0.06},
                  {.name = "phase_deg", .role = Parameter::Role::phase},
                  log_shape("tau_s", 0.03, 2, 6).on(Parameter::Scale::decay),
                  even_shape("frequency_hz", 0, 19, 39),
                  even_shape("share_of_direction", 0, 1, 2).generalising(1)};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    constexpr double nothing_left = 14;  // a millionth
    if (c.approach == 0 || c.since_move_s > nothing_left * p[2]) return Effect{};
    const double at = 2 * pi * p[3] * c.since_move_s + pi / 2 + p[1] * rad_per_deg;
    const double side = 1 + p[4] * (c.approach - 1);
    return Effect{.stage_rad = p[0] * rad_per_deg * side * std::exp(-c.since_move_s / p[2]) * std::sin(at)};
  };
  m.shows = [](const Finding& f, const Recorded& r) {  // until half of it has faded
    const double half = std::log(2.0) * f.at("tau_s").value * r.scan_hz;
    return std::vector<Interval>{{Coordinate::scan_seq, r.from, std::clamp(half, r.from + 1, r.to)}};
  };
  m.says = [](const Finding& f) {
    return "After a move the stage still swings by " + with_uncertainty(f.at("amplitude_deg"), "deg") +
           " at " + rounded(f.at("frequency_hz").value, 2) + " Hz and comes to rest within " +
           rounded(3 * f.at("tau_s").value, 2) + " s.";
  };
  m.separate = "wait longer between the move and the first scan";
  return m;
}

}  // namespace fit::mechanisms
