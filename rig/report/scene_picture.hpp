// SPDX-License-Identifier: MIT
#pragma once

#include <string>

#include "fit/recording.hpp"
#include "rig/report/plot.hpp"

namespace rig {

struct ScenePicture {
  Plot plot;  ///< Without series where the recording has no capture.
  std::string caption;
};

/// The mean echo of every beam of the widest capture, in the world frame, and the targets where the bench
/// says they are.
[[nodiscard]] ScenePicture scene_picture(const fit::Recording& recording);

}  // namespace rig
