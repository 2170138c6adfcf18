// SPDX-License-Identifier: MIT
#pragma once

#include <optional>

#include "fit/explain/explanation.hpp"

namespace fit::explain {

/// Crosstalk, where it shows: on the few beams beside an edge, which are left out of the means because nobody
/// knows to a tenth of a degree where an edge is. Here the recording itself tells which beam meets which
/// surface, and beams at least one and a half spacings from the change are compared with the plane of their
/// surface.
struct StrayLight {
  Suspect suspect;
  bool or_mixed_pixel = false;  ///< A beam that is too wide explains it as well.
  std::vector<Located> located;
};
[[nodiscard]] std::optional<StrayLight> stray_light(const Reduced& reduced, const MeanResult& means);

}  // namespace fit::explain
