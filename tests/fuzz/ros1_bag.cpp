// SPDX-License-Identifier: MIT
#include "rig/import/ros1_bag.hpp"

#include <sstream>

#include "rig/errors.hpp"
#include "rig/import/ros_messages.hpp"
#include "tests/support/nowhere_sink.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::istringstream in(std::string(reinterpret_cast<const char*>(data), size));
  NowhereSink sink;
  const rig::ImportOptions options;
  rig::RosMessages messages(sink, options, rig::Packing::ros1);
  try {
    (void)rig::read_ros1_bag(in, [&](const rig::Ros1Message& message) {
      messages.message(message.topic, message.type, message.log_time_ns, message.data);
      return message.data.size() < (1u << 20);
    });
  } catch (const rig::UsageError&) {
  }
  messages.finish();
  return 0;
}
