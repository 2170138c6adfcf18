// SPDX-License-Identifier: MIT
// Targets and their edges.
#include <algorithm>
#include <cmath>

#include "worlds/kind.hpp"

namespace challenge {

std::vector<Kind> kinds_of_targets() {
  return {{"target-offset",
           {"room", "boards"},
           [](S x, D d, double s) {
             return of_target(x, d, "offset_mm",
                              x.truth.offset_mm[d.wall] + away(x.truth.offset_mm[d.wall]) * 5 * s);
           },
           [](S x, D d, double s) {
             return json{{"target", name_of(x, d)}, {"offset_mm", away(x.truth.offset_mm[d.wall]) * 5 * s}};
           },
           12},
          {"target-tilt",
           {"room", "boards"},
           [](S x, D d, double s) {
             return of_target(x, d, "tilt_deg",
                              x.truth.tilt_rad[d.wall] / degree + away(x.truth.tilt_rad[d.wall]) * 0.3 * s);
           },
           [](S x, D d, double s) {
             return json{{"target", name_of(x, d)}, {"tilt_deg", away(x.truth.tilt_rad[d.wall]) * 0.3 * s}};
           },
           4},
          {"target-curvature",
           {"room", "boards"},
           [](S x, D d, double s) { return of_target(x, d, "sagitta_mm", d.sign * 3 * s); },
           [](S x, D d, double s) {
             return json{{"target", name_of(x, d)}, {"sagitta_mm", d.sign * 3 * s}};
           },
           20},
          {"mixed-pixel",
           {"edge"},
           [](S, D d, double) {
             return json{{"beam", {{"long_mrad", 8 + 8 * d.a}, {"short_mrad", 2.5}}},
                         {"receiver", {{"echo", "strongest"}}}};
           },
           [](S, D d, double) {
             return json{{"width_deg", (8 + 8 * d.a) / 4e3 / degree}};
           },
           1,
           false,
           false,
           true,
           {"incidence-bias"}}};  // on slanted walls a wide footprint is deep, and stretches the pulse
}

}  // namespace challenge
