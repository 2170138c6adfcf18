// SPDX-License-Identifier: MIT
// Mirror, beam angles and mount.
#include <algorithm>
#include <cmath>

#include "worlds/kind.hpp"

namespace challenge {

std::vector<Kind> kinds_of_angles() {
  return {
      {"encoder-eccentricity",
       {"room", "boards", "settle"},
       [](S, D d, double s) {
         return json{{"rotor", {{"disk_offset", 1e-3 * s}, {"disk_phase_deg", phase_deg(d.a)}}}};
       },
       [](S, D d, double s) {
         return json{{"amplitude_deg", 1e-3 * s / degree}, {"phase_deg", phase_deg(d.a)}};
       },
       200},
      {"encoder-second-harmonic",
       {"room", "boards"},
       [](S, D d, double s) {
         return json{{"rotor",
                      {{"disk_lean_deg", 2 * std::atan(std::sqrt(5e-4 * s)) / degree},
                       {"disk_lean_phase_deg", phase_deg(d.a)}}}};
       },
       [](S, D d, double s) {
         return json{{"amplitude_deg", 5e-4 * s / degree},
                     {"phase_deg", std::remainder(2 * phase_deg(d.a), 360)}};
       },
       100},
      {"angle-scale",
       {"room", "boards"},
       [](S, D d, double s) {
         return json{{"rotor", {{"speed_error", d.sign * 5e-4 * s}}}};
       },
       [](S, D d, double s) {
         return json{{"scale", d.sign * 5e-4 * s}};
       },
       200},
      {"index-offset",
       {"room"},
       [](S x, D d, double s) {
         return json{{"truth", {{"mount_yaw_deg", x.truth.yaw_rad / degree + d.sign * 0.5 * s}}}};
       },
       [](S, D d, double s) {
         return json{{"offset_deg", d.sign * 0.5 * s}};
       }},
      {"angle-jitter",
       {"room", "boards"},
       [](S, D, double s) {
         return json{{"rotor", {{"index_jitter_deg", 0.05 * s}}}};
       },
       [](S, D, double s) {
         return json{{"sigma_deg", 0.05 * s}};
       },
       80,
       true,
       false,
       false},
      {"lidar-arm",
       {"room", "boards"},
       [](S x, D d, double s) {
         const double to = phase_deg(d.a) * degree;
         return json{{"truth",
                      {{"mount_x_mm", x.truth.x_mm + 5 * s * std::cos(to)},
                       {"mount_y_mm", x.truth.y_mm + 5 * s * std::sin(to)}}}};
       },
       nothing_known,
       40},
      {"scan-plane-tilt",
       {"room"},
       [](S, D d, double s) {
         return json{{"rotor", {{"plane_tilt_deg", std::sqrt(s)}, {"plane_axis_deg", phase_deg(d.a) / 2}}}};
       },
       [](S, D, double s) {
         return json{{"tilt_squared_deg2", s}};
       },
       400},
      {"facet-wobble",
       {"room", "warmup"},
       [](S, D d, double s) {
         const int faces = 2 + static_cast<int>(3.99 * d.a);
         json list = json::array();
         double sum = 0;
         for (int i = 0; i < faces; ++i) {
           const double x = i + 1 < faces ? 3 * s * std::cos(i * (2 + d.b) + 6 * d.c) : -sum;
           sum += x;
           list.push_back({{"range_mm", x}});
         }
         return json{{"rotor", {{"facets", list}}}};
       },
       [](S, D d, double) {
         return json{{"facets", 2 + static_cast<int>(3.99 * d.a)}};
       },
       1e3,
       true,
       true}};
}

}  // namespace challenge
