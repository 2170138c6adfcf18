// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "fit/bench/bench.hpp"

namespace rig {

/// A topic that Foxglove is offered.
struct FoxgloveChannel {
  const char* topic;
  const char* schema_name;
  nlohmann::json schema;  ///< JSON schema of its messages.
  bool all = false;       ///< Every message counts (a log), not the newest alone.
};

/// In the order of their numbers, from 1.
[[nodiscard]] const std::vector<FoxgloveChannel>& foxglove_channels();

struct FoxgloveMessage {
  std::size_t channel;  ///< Index into foxglove_channels().
  nlohmann::json body;
};

/// The messages that a state of the live page (`live/1`, docs/reference/live.md) becomes. Of its log those
/// after the first `logged`; pure.
[[nodiscard]] std::vector<FoxgloveMessage> foxglove_messages(const nlohmann::json& state,
                                                             std::int64_t time_ns, const fit::Mount& lidar,
                                                             std::uint64_t logged);

}  // namespace rig
