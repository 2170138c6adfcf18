// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <cstdint>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "rig/live/web_access.hpp"

namespace rig {

extern const char* const live_page;     ///< One run.
extern const char* const benches_page;  ///< All runs of a folder.

/// The live page: one small web server that shows the latest state of a run to any number of browsers and
/// hands their buttons back. It can neither slow nor stop a run: publish() only stores the text, each browser
/// gets the newest state at most 20 times a second, and one that does not read is dropped.
///
///   LiveServer live(executor, options, [&](const nlohmann::json& command) { runner.command(command); });
///   live.publish(state);   // docs/reference/live.md describes state and commands
///
/// It listens on the loopback interface. On any other address a token is required, in the page's address and
/// in every request. Requests of foreign pages are refused (Origin and Host are checked).
class LiveServer {
 public:
  using Options = WebAccess;
  using OnCommand = std::function<void(const nlohmann::json& command)>;

  /// Throws UsageError when the address cannot be listened on, or is not loopback and there is no token.
  /// `page`: what the browser gets, a page that draws the state.
  LiveServer(boost::asio::any_io_executor executor, const Options& options, OnCommand on_command,
             const char* page = live_page);
  ~LiveServer();
  LiveServer(const LiveServer&) = delete;
  LiveServer& operator=(const LiveServer&) = delete;

  [[nodiscard]] std::uint16_t port() const;
  /// What the operator types into a browser, token included.
  [[nodiscard]] std::string url() const;
  void publish(const nlohmann::json& state);
  /// The picture of the prompt that waits, at /picture; no bytes: there is none.
  void show_picture(const std::string& type, std::string bytes);
  /// Lets every browser have the last state, for at most a second, then stops and calls `done`.
  void finish(std::function<void()> done);
  /// Closes every connection; publish() does nothing from then on.
  void stop();

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

}  // namespace rig
