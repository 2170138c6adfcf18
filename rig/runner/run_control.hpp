// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/awaitable.hpp>

#include "rig/runner/gate.hpp"
#include "rig/session/session_store.hpp"

namespace rig {

/// What was asked of a run from outside: to stop for good, or to pause at its next checkpoint. What was
/// stopped stays stopped; a stop ends a pause.
class RunControl {
 public:
  explicit RunControl(const SessionStore& session) : session_(session) {}

  void abort();
  /// As abort(), by whoever was asked: the run is at a prompt, so that nobody has to be woken.
  void abort_at_prompt() { aborted_ = true; }
  void pause();
  void resume();

  [[nodiscard]] bool aborted() const { return aborted_; }
  [[nodiscard]] bool paused() const { return paused_; }
  /// Throws RunStopped, which says how to go on; `made_safe`: what the end of the run gave.
  void stop_if_aborted(const std::string& made_safe = "") const;

  /// Where the captures are, and how to resume; empty if there are none.
  [[nodiscard]] std::string how_to_go_on() const;

  boost::asio::awaitable<void> until_aborted();
  /// Until resume() or abort().
  boost::asio::awaitable<void> until_resumed();

 private:
  const SessionStore& session_;
  bool aborted_ = false, paused_ = false;
  Gate abort_, resume_;
};

}  // namespace rig
