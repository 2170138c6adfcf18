// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/scene.hpp"

namespace fit::explain::reduction {

/// In standard uncertainties of the mount: which wall a beam near a corner meets depends on where mount and
/// walls really are.
constexpr double doubt_of_mount = 3;

/// How far along a wall (mm) a beam may be off at that range, in so many standard uncertainties of the mount.
[[nodiscard]] double sway_mm(const Mount& mount, double range_mm, double uncertainties);

/// How near (mm) to a corner of its target a beam that sways so far may come for its mean to be compared.
[[nodiscard]] double corner_margin_mm(const Sight& sight, double sway_mm);

}  // namespace fit::explain::reduction
