// SPDX-License-Identifier: MIT
// What is in no catalogue.
#include <algorithm>
#include <cmath>

#include "worlds/kind.hpp"

namespace challenge {

std::vector<Kind> kinds_outside_the_catalogue() {
  return {
      {"unknown-ripple",
       {"room", "settle"},
       [](S, D d, double s) {
         return json{
             {"rotor", {{"ripple_deg", 0.05 * s}, {"ripple_order", 4 + static_cast<int>(4.99 * d.a)}}}};
       },
       nothing_known,
       90},
      {"unknown-angle-step",
       {"room"},
       [](S, D d, double s) {
         return json{{"rotor", {{"lost_slit_deg", 0.1 * s}, {"lost_slit_at_deg", -80 + 160 * d.a}}}};
       },
       nothing_known,
       40},
      {"unknown-sawtooth",
       {"room"},
       [](S, D d, double s) {
         return json{{"rotor", {{"interpolation_deg", 0.05 * s}, {"slits", 9 + static_cast<int>(16 * d.a)}}}};
       },
       nothing_known,
       90}};
}

}  // namespace challenge
