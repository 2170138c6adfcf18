// SPDX-License-Identifier: MIT
#include "rig/runner/scan_gate.hpp"

#include <algorithm>
#include <cmath>

namespace rig {

int skip_for(double spacing_s, double scan_hz) {
  const long periods = std::lround(spacing_s * scan_hz);
  for (long each = std::min(10L, periods); each > 1; --each)
    if (periods % each == 0) return static_cast<int>(each - 1);
  return 0;
}

LidarStream whole_scan(const fit::LidarGeometry& lidar) {
  LidarStream stream;
  stream.first_step = lidar.first_step;
  stream.last_step = lidar.steps - 1;
  return stream;
}

LidarStream stream_for(const CaptureRequest& request, int skip) {
  LidarStream stream;
  stream.first_step = request.first_step;
  stream.last_step = request.last_step;
  stream.cluster = request.cluster;
  stream.intensity = request.intensity;
  stream.skip = skip;
  return stream;
}

}  // namespace rig
