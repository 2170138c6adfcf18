// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/margins.hpp"

#include <cmath>

namespace fit::explain::reduction {

double sway_mm(const Mount& mount, double range_mm, double uncertainties) {
  return uncertainties * (mount.yaw_rad.u * range_mm + std::hypot(mount.x_mm.u, mount.y_mm.u));
}

double corner_margin_mm(const Sight& sight, double sway_mm) {
  return 8 + 0.003 * sight.range_mm + sway_mm / sight.cos_incidence();
}

}  // namespace fit::explain::reduction
