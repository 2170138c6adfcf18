// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <cstdint>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "fit/bench/bench.hpp"
#include "rig/live/web_access.hpp"

namespace rig {

/// Serves a run by the Foxglove WebSocket protocol (github.com/foxglove/ws-protocol, docs/spec.md;
/// subprotocols foxglove.websocket.v1 and foxglove.sdk.v1), read only, every message as JSON with its schema:
///   /scan foxglove.LaserScan, /tf foxglove.FrameTransform (stage), /messages foxglove.Log,
///   /beam, /stage, /step and /results: objects of ours
/// It can neither slow nor stop a run: publish() only stores what is new, each client gets the newest message
/// of a topic at most 20 times a second (every one of /messages), and one that does not read is dropped.
/// A client that subscribes late gets the last message at once.
///
/// Web pages may connect from this computer and from Foxglove's own site; others are refused.
class FoxgloveServer {
 public:
  /// Throws UsageError as listen_on().
  FoxgloveServer(boost::asio::any_io_executor executor, const WebAccess& access, const fit::Mount& lidar);
  ~FoxgloveServer();
  FoxgloveServer(const FoxgloveServer&) = delete;
  FoxgloveServer& operator=(const FoxgloveServer&) = delete;

  [[nodiscard]] std::uint16_t port() const;
  /// What the operator types into Foxglove's "Open connection".
  [[nodiscard]] std::string url() const;
  /// The state of the live page (`live/1`, docs/reference/live.md) at a moment, nanoseconds of the Unix
  /// epoch.
  void publish(const nlohmann::json& state, std::int64_t time_ns);
  /// Lets every client have the last messages, for at most a second, then stops and calls `done`.
  void finish(std::function<void()> done);
  void stop();

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

}  // namespace rig
