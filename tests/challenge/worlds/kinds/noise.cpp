// SPDX-License-Identifier: MIT
// Noise and lost echoes.
#include <algorithm>
#include <cmath>

#include "worlds/kind.hpp"

namespace challenge {

std::vector<Kind> kinds_of_noise() {
  return {
      {"range-noise",
       {"room", "ladder"},
       [](S x, D, double s) {
         return json{
             {"counter", {{"jitter_ns", std::sqrt(x.sigma_mm * x.sigma_mm + 4 * s) / light_mm_per_ns}}}};
       },
       [](S, D, double s) {
         return json{{"extra_sigma_mm", 2 * std::sqrt(s)}};
       },
       1e4,
       true,
       false,
       false},
      {"intensity-noise",
       {"ladder", "room", "reflectance-ladder"},
       [](S, D d, double s) {
         return json{{"receiver",
                      {{"noise", std::min(0.5, 0.02 * std::sqrt(s) * d.power.low)}, {"timing", "fraction"}}}};
       },
       nothing_known,
       400,
       true,
       false,
       false},
      {"sunlight",
       {"warmup", "room"},
       [](S x, D d, double s) {
         const bool narrow = x.scene == "warmup";
         return json{{"light",
                      {{"suns",
                        {{{"centre_deg", (narrow ? 50 : 110) * (2 * d.a - 1)},
                          {"width_deg", 8 + 15 * d.b},
                          {"noise", std::min(0.5, 0.01 * std::sqrt(s) * d.power.low)}}}}}}};
       },
       [](S x, D d, double) {
         const bool narrow = x.scene == "warmup";
         return json{{"centre_deg", (narrow ? 50 : 110) * (2 * d.a - 1)}};
       },
       400,
       true,
       false,
       false},
      {"correlated-noise",
       {"ladder", "warmup", "room"},
       [](S, D, double s) {
         return json{{"counter", {{"jitter_memory", std::min(0.98, 0.1 * s)}}}};
       },
       [](S, D, double s) {
         return json{{"rho", std::min(0.98, 0.1 * s)}};
       },
       9.8,
       true,
       false,
       false},
      {"rounding",
       {"room", "ladder"},
       [](S, D d, double) {
         return json{{"firmware", {{"step_mm", 4 + std::floor(8 * d.a)}}}};
       },
       [](S, D d, double) {
         return json{{"step_mm", 4 + std::floor(8 * d.a)}};
       },
       1,
       false,
       false,
       false},
      {"outliers",
       {"room", "ladder"},
       [](S, D, double s) {
         return json{{"air", {{"dust_per_m", std::min(0.2, 0.002 * s)}}}};
       },
       nothing_known,
       100,
       true,
       false,
       false},
      {"dropout",
       {"ladder", "room"},
       [](S, D d, double s) {
         // Counted in the noise's standard deviations from where hardly any echo is lost, so that losses grow
         // smoothly.
         const double noise = 0.004 * d.power.low;
         return json{{"receiver", {{"threshold", d.power.low + (s - 5) * noise}, {"noise", noise}}}};
       },
       nothing_known,
       30}};
}

}  // namespace challenge
