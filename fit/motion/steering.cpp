// SPDX-License-Identifier: MIT
#include "fit/motion/steering.hpp"

#include "fit/find_by_id.hpp"

namespace fit {
namespace steerings {
std::vector<Steering> all();
}

const std::vector<Steering>& all_steerings() {
  static const std::vector<Steering> known = steerings::all();
  return known;
}

const Steering* find_steering(const std::string& id) { return find_by_id(all_steerings(), id); }

const Steering& differential() {
  static const Steering& known = *find_steering("differential");
  return known;
}

}  // namespace fit
