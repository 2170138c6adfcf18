// SPDX-License-Identifier: MIT
// What shows in the intensity.
#include <algorithm>
#include <cmath>

#include "worlds/kind.hpp"

namespace challenge {

std::vector<Kind> kinds_of_light() {
  return {
      {"radiometry",
       {"ladder", "boards", "room", "reflectance-ladder"},
       [](S x, D d, double s) {
         if (d.a < 0.4) return json{{"receiver", {{"overlap_mm", 80 * (1 + 0.5 * s)}}}};
         return json{{"receiver", {{"counts_exponent", x.radiometer.exponent * (1 + d.sign * 0.02 * s)}}}};
       },
       [](S x, D d, double s) {
         if (d.a < 0.4) return json{{"overlap_mm", 80 * (1 + 0.5 * s)}};
         const double now = x.radiometer.exponent * (1 + d.sign * 0.02 * s);
         return json{{"range_power", 2 * now}, {"incidence_power", now}, {"reflectance_power", now}};
       },
       25},
      {"window-dirt",
       {"room", "boards"},
       [](S x, D d, double s) {
         const bool narrow = x.scene == "warmup";
         return json{{"housing",
                      {{"dirt",
                        {{{"centre_deg", (narrow ? 45 : 110) * (2 * d.a - 1)},
                          {"width_deg", 3 + 12 * d.b},
                          {"loss", 1 - std::exp(-0.01 * s)}}}}}}};
       },
       [](S x, D d, double) {
         return json{{"centre_deg", (x.scene == "warmup" ? 45 : 110) * (2 * d.a - 1)},
                     {"width_deg", (3 + 12 * d.b) / std::sqrt(2.0)}};
       },
       120},
      {"specular",
       {"room", "boards"},
       [](S x, D d, double s) {
         json one = of_target(x, d, "specular", 0.1 * s);
         one["truth"]["targets"][name_of(x, d)]["specular_width_deg"] = 2 + 8 * d.b;
         return one;
       },
       [](S x, D d, double) {
         return json{{"target", name_of(x, d)}};
       },
       500},
      {"unknown-stripe",
       {"room", "boards"},
       [](S x, D d, double s) {
         const double along = 400 * (2 * d.a - 1);
         const double grey = x.walls[d.wall].reflectance * std::exp(-0.02 * s);
         json stripe{{"from_mm", along - 120}, {"to_mm", along + 120}, {"reflectance", grey}};
         json world;
         world["truth"]["targets"][name_of(x, d)]["stripes"] = json::array({stripe});
         return world;
       },
       nothing_known,
       100}};
}

}  // namespace challenge
