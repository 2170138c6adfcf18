// SPDX-License-Identifier: MIT
#include "fit/bench/bench.hpp"

#include <algorithm>

namespace fit {

Eigen::Vector2d Target::outward_normal() const {
  if (round) {
    const double away_mm = round->centre_mm.norm();
    return away_mm > 0 ? Eigen::Vector2d(round->centre_mm / away_mm) : Eigen::Vector2d::UnitX();
  }
  const Eigen::Vector2d along = (to_mm - from_mm).normalized();
  const Eigen::Vector2d normal(along.y(), -along.x());
  return normal.dot(from_mm) >= 0 ? normal : Eigen::Vector2d(-normal);
}

void Target::set_round(const RoundShape& shape) {
  round = shape;
  const Eigen::Vector2d outward = outward_normal(), across(-outward.y(), outward.x()),
                        front = shape.centre_mm - shape.radius_mm * outward;
  from_mm = front - shape.radius_mm * across;
  to_mm = front + shape.radius_mm * across;
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
