// SPDX-License-Identifier: MIT
// Range, light and time of flight.
#include <algorithm>
#include <cmath>

#include "worlds/kind.hpp"

namespace challenge {

std::vector<Kind> kinds_of_ranges() {
  return {
      {"zero-offset",
       {"room", "ladder", "boards"},
       [](S, D d, double s) {
         return json{{"housing", {{"delay_ns", d.sign * 0.05 * s}}}};
       },
       [](S, D d, double s) {
         return json{{"offset_mm", d.sign * 0.05 * s * light_mm_per_ns}};
       }},
      {"range-scale",
       {"ladder", "room", "boards"},
       [](S, D d, double s) {
         return json{{"counter", {{"ppm", d.sign * 1000 * s}}}};
       },
       [](S, D d, double s) {
         return json{{"scale", d.sign * 1e-3 * s}};
       },
       100},
      {"range-walk",
       {"ladder", "reflectance-ladder", "boards"},
       [](S, D d, double s) {
         return json{{"receiver", {{"compensation", 1 - 0.03 * s}}},
                     {"pulse", {{"rise_ns", 1.5 + 1.5 * d.a}}}};
       },
       nothing_known,
       33},
      {"saturation",
       {"reflectance-ladder", "ladder"},
       [](S, D d, double s) {
         const double clip = std::max(1.5 * d.power.low, d.power.high * (0.15 + 0.2 * d.a));
         return json{{"receiver", {{"clip", clip}}}, {"pulse", {{"rise_ns", 0.2 * s}}}};
       },
       nothing_known,
       40},
      {"cyclic-error",
       {"ladder", "room"},
       [](S, D d, double s) {
         const double period = log_between(d.a, 350, 2500);
         return json{{"counter",
                      {{"leak", std::min(1.0, 0.004 * s * d.power.low)},
                       {"leak_mhz", 1e3 * light_mm_per_ns / period},
                       {"leak_phase_deg", phase_deg(d.b)}}}};
       },
       [](S, D d, double) {
         return json{{"period_mm", log_between(d.a, 350, 2500)}};
       },
       25},
      {"near-field",
       {"ladder", "box"},
       [](S, D d, double s) {
         return json{
             {"housing", {{"flash", d.sign * 0.04 * s * d.power.low}, {"flash_decay_ns", 1.2 + 2 * d.a}}}};
       },
       [](S, D d, double) {
         return json{{"reach_mm", (1.2 + 2 * d.a) * light_mm_per_ns}};
       },
       40},
      {"window-reflection",
       {"box"},
       [](S, D d, double s) {
         return json{{"housing",
                      {{"glint", d.sign * 0.04 * s * d.power.low},
                       {"flash_decay_ns", 1.2 + 2 * d.a},
                       {"glint_centre_deg", -90 + 180 * d.b},
                       {"glint_width_deg", 12 + 20 * d.c}}}};
       },
       [](S, D d, double) {
         return json{{"centre_deg", -90 + 180 * d.b}};
       },
       40},
      {"incidence-bias",
       {"room"},
       [](S, D, double s) {
         const double width = 4 * std::sqrt(s);
         return json{{"beam", {{"long_mrad", width}, {"short_mrad", width}}},
                     {"pulse", {{"rise_ns", 0.4}}},
                     {"receiver", {{"timing", "fraction"}, {"fraction", 0.5}}}};
       },
       nothing_known,
       60,
       true,
       false,
       true,
       {"mixed-pixel"}},  // such a beam meets two surfaces at an edge
      {"subsurface",
       {"room", "boards"},
       [](S x, D d, double s) { return of_target(x, d, "depth_mm", 5 * s); },
       [](S x, D d, double s) {
         return json{{"target", name_of(x, d)}, {"depth_mm", 5 * s}};
       },
       60},
      {"warm-up",
       {"warmup", "heat-cycle"},
       [](S, D d, double s) {
         return json{{"heat",
                      {{"delay_ps_per_k", d.sign * 3.3 * s},
                       {"rise_fast_k", 3 * d.a},
                       {"rise_slow_k", 10 - 3 * d.a},
                       {"fast_s", 60 + 120 * d.b},
                       {"slow_s", 400 + 700 * d.c}}}};
       },
       [](S, D d, double s) {
         return json{{"amplitude_mm", d.sign * 33e-3 * s * light_mm_per_ns}};
       }},
      {"temperature",
       {"heat-cycle", "warmup"},
       [](S x, D d, double s) {
         return json{
             {"heat", {{"delay_ps_per_k", d.sign * 3.3 * s}, {"reference_c", x.captures[0].temperature_c}}}};
       },
       [](S, D d, double s) {
         return json{{"slope_mm_per_k", d.sign * 3.3e-3 * s * light_mm_per_ns}};
       }},
      {"multipath",
       {"room"},
       [](S x, D, double s) {
         json targets = json::object();
         for (const Wall& wall : x.walls)
           targets[wall.name] = {{"gloss", std::min(0.95, 0.2 * std::sqrt(s))}};
         return json{{"truth", {{"targets", targets}}}};
       },
       nothing_known,
       22},
      {"crosstalk",
       {"panels"},
       [](S, D d, double s) {
         return json{
             {"receiver", {{"stray", std::min(1.0, 0.004 * s)}, {"stray_width_deg", 0.5 + 0.7 * d.a}}}};
       },
       nothing_known,
       250},
      {"air-index",
       {"ladder"},
       [](S, D, double s) {
         return json{{"air", {{"index_error", 2.7e-4 * s}}}};
       },
       [](S, D, double s) {
         return json{{"index_error", 2.7e-4 * s}};
       },
       1.2}};  // No air refracts more (dense and cold: 3.2e-4).
}

}  // namespace challenge
