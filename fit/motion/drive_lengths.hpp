// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/motion/drive.hpp"

namespace fit {

/// Of the lengths at which scans were matched (`out.lengths`, with the samples and the fit of each) the one
/// is taken, or the value for an endless way, whose expected squared error is least: scatter, and the part of
/// the drift up to an endless way that is not scatter. The drift from the length taken stays in the
/// uncertainty, and so does the lidar's scale, whose relative limit is `range_scale`.
void choose_length(DriveFit& out, const std::vector<std::vector<WheelSample>>& samples,
                   const std::vector<OdometryFit>& fits, double range_scale);

}  // namespace fit
