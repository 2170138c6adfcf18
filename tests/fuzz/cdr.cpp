// SPDX-License-Identifier: MIT
#include "rig/import/cdr.hpp"

#include "rig/import/ros_messages.hpp"

namespace {

/// Takes anything, and looks at what it is given.
class Nowhere : public rig::ImportSink {
 public:
  void scan(const rig::ImportedScan& scan) override { seen_ += scan.range_mm.size() + scan.intensity.size(); }
  void pose(std::int64_t, const std::string&, const std::string&, const fit::TrackPose&) override {}
  void imu(std::int64_t, const std::string&, double, double) override {}
  void transform(const rig::ImportedTransform&) override {}
  void property(const std::string&, const std::string&) override {}
  void note(const std::string&) override {}
  bool wants_more() const override { return true; }

 private:
  std::size_t seen_ = 0;
};

}  // namespace

// The first byte chooses the message type, the rest is the message.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  static const char* const types[] = {"sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry",
                                      "sensor_msgs/msg/JointState", "sensor_msgs/msg/Imu",
                                      "tf2_msgs/msg/TFMessage"};
  Nowhere sink;
  const rig::ImportOptions options;
  rig::RosMessages messages(sink, options);
  messages.message("/tf_static", types[data[0] % 5], 0, {data + 1, size - 1});
  messages.finish();
  return 0;
}
