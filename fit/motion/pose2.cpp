// SPDX-License-Identifier: MIT
#include "fit/motion/pose2.hpp"

#include <algorithm>

namespace fit {

Pose2 interpolate(const Pose2& a, const Pose2& b, double share) {
  return {a.x_mm + share * (b.x_mm - a.x_mm), a.y_mm + share * (b.y_mm - a.y_mm),
          a.heading_rad + share * wrap_angle(b.heading_rad - a.heading_rad)};
}

Path::Path(std::vector<TimedPose> poses) {
  std::stable_sort(poses.begin(), poses.end(),
                   [](const TimedPose& a, const TimedPose& b) { return a.time_s < b.time_s; });
  for (const TimedPose& next : poses) {
    if (poses_.empty()) {
      poses_.push_back(next);
      continue;
    }
    TimedPose unwrapped = next;
    const double before = poses_.back().pose.heading_rad;
    unwrapped.pose.heading_rad = before + wrap_angle(next.pose.heading_rad - before);
    if (next.time_s == poses_.back().time_s)
      poses_.back() = unwrapped;
    else
      poses_.push_back(unwrapped);
  }
}

Pose2 Path::at(double time_s) const {
  if (poses_.size() == 1) return poses_.front().pose;
  const double t = std::clamp(time_s, begin_s() - coast_s, end_s() + coast_s);
  auto after = std::upper_bound(poses_.begin() + 1, poses_.end() - 1, t,
                                [](double time, const TimedPose& pose) { return time < pose.time_s; });
  const TimedPose &a = *(after - 1), &b = *after;
  return interpolate(a.pose, b.pose, (t - a.time_s) / (b.time_s - a.time_s));
}

}  // namespace fit
