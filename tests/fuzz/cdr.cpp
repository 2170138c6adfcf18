// SPDX-License-Identifier: MIT
#include "rig/import/cdr.hpp"

#include "rig/import/ros_messages.hpp"
#include "tests/support/nowhere_sink.hpp"

// The first byte chooses the message type, the rest is the message.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  static const char* const types[] = {"sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry",
                                      "sensor_msgs/msg/JointState", "sensor_msgs/msg/Imu",
                                      "tf2_msgs/msg/TFMessage"};
  NowhereSink sink;
  const rig::ImportOptions options;
  rig::RosMessages messages(sink, options);
  messages.message("/tf_static", types[data[0] % 5], 0, {data + 1, size - 1});
  messages.finish();
  return 0;
}
