// SPDX-License-Identifier: MIT
#include "rig/import/ros1_bag.hpp"

#include <fstream>
#include <memory>

#include "rig/errors.hpp"
#include "rig/import/ros_messages.hpp"

namespace rig::importers {
namespace {

class Ros1Bag : public Importer {
 public:
  std::string name() const override { return "ROS 1 bag (.bag)"; }

  bool recognises(const std::string& path, std::span<const std::uint8_t> first_bytes) const override {
    return is_ros1_bag(first_bytes) || (path.ends_with(".bag") && !first_bytes.empty());
  }

  void read(const std::string& path, const ImportOptions& options, ImportSink& sink) const override {
    std::ifstream in(path, std::ios::binary);
    if (!in) throw UsageError(path + " cannot be opened. Check the name and the permissions.");
    RosMessages messages(sink, options, Packing::ros1);
    Ros1Summary summary;
    try {
      summary = read_ros1_bag(in, [&](const Ros1Message& message) {
        messages.message(message.topic, message.type, message.log_time_ns, message.data);
        return sink.wants_more();
      });
    } catch (const UsageError& error) {
      throw UsageError(path + ": " + error.what());
    }
    for (const auto& note : summary.notes) sink.note(note);
    messages.finish();
  }
};

}  // namespace

std::unique_ptr<Importer> make_ros1_bag() { return std::make_unique<Ros1Bag>(); }

}  // namespace rig::importers
