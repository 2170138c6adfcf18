// SPDX-License-Identifier: MIT
#include "rig/import/mcap.hpp"

#include <fstream>
#include <memory>

#include "rig/errors.hpp"
#include "rig/import/ros_messages.hpp"

namespace rig::importers {
namespace {

class Mcap : public Importer {
 public:
  std::string name() const override { return "ROS 2 bag (MCAP)"; }

  bool recognises(const std::string& path, std::span<const std::uint8_t> first_bytes) const override {
    return is_mcap(first_bytes) || (path.ends_with(".mcap") && !first_bytes.empty());
  }

  void read(const std::string& path, const ImportOptions& options, ImportSink& sink) const override {
    std::ifstream in(path, std::ios::binary);
    if (!in) throw UsageError(path + " cannot be opened. Check the name and the permissions.");
    RosMessages messages(sink, options);
    bool foreign = false;
    McapSummary summary;
    try {
      summary = read_mcap(in, [&](const McapMessage& message) {
        if (message.encoding == "cdr")
          messages.message(message.topic, message.type, static_cast<std::int64_t>(message.log_time_ns),
                           message.data);
        else
          foreign = true;
        return sink.wants_more();
      });
    } catch (const UsageError& error) {
      throw UsageError(path + ": " + error.what());
    }
    for (const auto& note : summary.notes) sink.note(note);
    if (foreign) sink.note("Messages that are not CDR (as ROS 1 or JSON channels hold) were left out.");
    messages.finish();
  }
};

}  // namespace

std::unique_ptr<Importer> make_mcap() { return std::make_unique<Mcap>(); }

}  // namespace rig::importers
