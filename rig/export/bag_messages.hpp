// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <string>

#include "rig/session/session_store.hpp"

namespace rig {

/// A ROS 2 bag that is being written, whatever stores it.
class BagSink {
 public:
  virtual ~BagSink() = default;
  struct Channel {
    std::string topic, type, definition;  ///< `definition`: of the type and all it is made of (ros2msg).
    bool latched = false;                 ///< What late subscribers are to get as well (/tf_static).
  };
  virtual std::uint16_t add_channel(const Channel& channel) = 0;
  /// `cdr`: the message's bytes. In the order of their times, capture by capture.
  virtual void add_message(std::uint16_t channel, std::uint64_t time_ns, const std::string& cdr) = 0;
};

/// What bags get of a session, in one clock, the lidar's frame "laser" on "base_link":
///   /scan          sensor_msgs/LaserScan       every scan as it came
///   /joint_states  sensor_msgs/JointState      stage angle; wheel angles, where there are any
///   /odom, /tf     nav_msgs/Odometry, TFMessage: base_link in odom, where the session has a track
///   /tf_static     TFMessage                   the lidar on base_link
///   /points        sensor_msgs/PointCloud2     deskewed points, in the lidar's frame when the scan began
/// Of a deskewed session /odom and /tf are the fused poses, one a scan, at the scan's own stamp: what shows
/// /points in odom shows the corrected map.
void write_bag(const SessionStore& session, BagSink& out);

}  // namespace rig
