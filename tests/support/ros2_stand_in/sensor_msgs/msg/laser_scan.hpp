// SPDX-License-Identifier: MIT
// The fields of sensor_msgs/LaserScan that the example uses.
#pragma once

#include <memory>
#include <vector>

namespace sensor_msgs::msg {
struct LaserScan {
  using ConstSharedPtr = std::shared_ptr<const LaserScan>;
  std::vector<float> ranges, intensities;
};
}  // namespace sensor_msgs::msg
