// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "fit/motion/odometry.hpp"

namespace rig {

/// The samples of some tuple files, every file a run.
struct Tuples {
  std::vector<fit::WheelSample> samples;
  std::vector<std::string> runs;
  bool timed = true;  ///< Every sample says when it began.
};

/// Adds a file, one run. One object a line: T in s, phi_l and phi_r in rad/s, sm = [x m, y m, theta rad] (the
/// format of Censi's public programs), perhaps t in s, when it began. Of a tricycle: phi in rad/s and steer
/// in rad. Throws UsageError, naming file and object.
void read_tuples(const std::string& path, const fit::Steering& steering, Tuples& out);

}  // namespace rig
