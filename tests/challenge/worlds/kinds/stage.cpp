// SPDX-License-Identifier: MIT
// The stage and its clock.
#include <algorithm>
#include <cmath>

#include "worlds/kind.hpp"

namespace challenge {

std::vector<Kind> kinds_of_stage() {
  return {
      {"stage-periodic",
       {"two-sided", "room"},
       [](S, D d, double s) {
         static constexpr int teeth[] = {120, 144, 180};
         return json{{"stage",
                      {{"worm_deg", 0.01 * s},
                       {"worm_teeth", teeth[static_cast<int>(2.99 * d.a)]},
                       {"worm_phase_deg", phase_deg(d.b)},
                       {"worm_second", 0.15 * d.c}}}};
       },
       [](S, D d, double s) {
         static constexpr double period[] = {3, 2.5, 2};
         return json{{"amplitude_deg", 0.01 * s}, {"period_deg", period[static_cast<int>(2.99 * d.a)]}};
       },
       400},
      {"stage-scale",
       {"room", "boards"},
       [](S, D d, double s) {
         return json{{"stage", {{"scale", d.sign * 1e-3 * s}}}};
       },
       [](S, D d, double s) {
         return json{{"scale", d.sign * 1e-3 * s}};
       },
       90},
      {"stage-eccentricity",
       {"room"},
       [](S, D d, double s) {
         return json{{"stage", {{"runout_mm", 0.3 * s}, {"runout_phase_deg", phase_deg(d.a)}}}};
       },
       [](S, D, double s) {
         return json{{"amplitude_mm", 0.3 * s}};
       },
       10},  // 3 mm: a stage whose axis wanders more is broken.
      {"backlash",
       {"room", "two-sided", "boards"},
       [](S, D, double s) {
         return json{{"stage", {{"play_deg", 0.05 * s}}}};
       },
       [](S, D, double s) {
         return json{{"width_deg", 0.05 * s}};
       },
       150},
      {"settling",
       {"settle"},
       [](S, D d, double s) {
         // The mirror sweeps while the table rings.
         return json{{"rotor", {{"rolling", true}}},
                     {"stage",
                      {{"ring_deg", 0.03 * s}, {"ring_hz", 3 + 7 * d.a}, {"ring_decay_s", 0.1 + 0.4 * d.b}}}};
       },
       [](S, D d, double s) {
         return json{{"amplitude_deg", 0.03 * s}, {"frequency_hz", 3 + 7 * d.a}, {"tau_s", 0.1 + 0.4 * d.b}};
       },
       200,
       true,
       true},
      {"motion-skew",
       {"turning"},
       [](S, D, double) {
         return json{{"rotor", {{"rolling", true}}}};
       },
       [](S, D, double) {
         return json{{"share", 1}};
       },
       3,
       true,
       true},
      {"time-offset",
       {"turning"},
       [](S, D d, double s) {
         return json{{"stage", {{"late_ms", d.sign * 10 * s}}}};
       },
       [](S, D d, double s) {
         return json{{"offset_ms", -d.sign * 10 * s}};
       },
       1e3,
       true,
       true}};
}

}  // namespace challenge
