// SPDX-License-Identifier: MIT
#pragma once

#include <optional>

#include "fit/explain/explanation.hpp"

namespace fit::explain {

/// Light of one surface in the echo of another, which this room finds, and a beam that is too wide, which
/// looks like it.
inline constexpr const char *crosstalk = "crosstalk", *wide_beam = "mixed-pixel";

/// Crosstalk, where it shows: on the few beams beside an edge, which are left out of the means because nobody
/// knows to a tenth of a degree where an edge is. Here the recording itself tells which beam meets which
/// surface, and beams at least one and a half spacings from the change are compared with the plane of their
/// surface.
struct StrayLight {
  Suspect suspect;
  bool or_mixed_pixel = false;  ///< A beam that is too wide explains it as well, ...
  double width_deg = 0;         ///< ... of that standard half width.
  std::vector<Located> located;
};
/// None where it is known already. What the search of the means found of it is judged anew here: the beams
/// beside edges, which it does not look at, say more.
[[nodiscard]] std::optional<StrayLight> stray_light(const Reduced& reduced, const MeanResult& means);

/// What recordings are worth between the two, nats: the log of the odds that are expected when one (row:
/// crosstalk, a wide beam) is true as it came out, and the other (column) takes up what it can.
[[nodiscard]] Eigen::MatrixXd evidence_between(const Reduced& reduced, const EdgeSuspects& suspects);

/// Puts what was found into the bench, and takes it off the cells beside edges: what stray light pulls out of
/// place there is no wide beam's doing, nor any other physics. How far its halo reaches differs from receiver
/// to receiver: means near edges are left out.
void take_off(const StrayLight& light, Reduced& reduced);

}  // namespace fit::explain
