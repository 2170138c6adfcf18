// SPDX-License-Identifier: MIT
#include "fit/bench.hpp"

#include <algorithm>

namespace fit {

Eigen::Vector2d Target::outward_normal() const {
  const Eigen::Vector2d along = (to_mm - from_mm).normalized();
  const Eigen::Vector2d normal(along.y(), -along.x());
  return normal.dot(from_mm) >= 0 ? normal : Eigen::Vector2d(-normal);
}

const Target* Bench::target(const std::string& name) const {
  const auto it = std::ranges::find(targets, name, &Target::name);
  return it == targets.end() ? nullptr : &*it;
}

const KnownMechanism* Bench::knows(const std::string& mechanism) const {
  const auto it = std::ranges::find(known, mechanism, &KnownMechanism::mechanism);
  return it == known.end() ? nullptr : &*it;
}

}  // namespace fit
