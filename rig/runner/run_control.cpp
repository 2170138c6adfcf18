// SPDX-License-Identifier: MIT
#include "rig/runner/run_control.hpp"

#include "rig/runner/runner.hpp"

namespace rig {

void RunControl::abort() {
  aborted_ = true;
  abort_.open();
  resume_.open();
}

void RunControl::pause() {
  paused_ = true;
  resume_.close();
}

void RunControl::resume() {
  paused_ = false;
  resume_.open();
}

void RunControl::stop_if_aborted(const std::string& made_safe) const {
  if (!aborted_) return;
  const std::string next = how_to_go_on();
  throw RunStopped("Stopped by the operator. " + made_safe + (made_safe.empty() ? "" : " ") +
                   (next.empty() ? "Nothing was captured yet." : next));
}

std::string RunControl::how_to_go_on() const {
  try {
    if (session_.progress().empty()) return "";
    return "What was captured is in " + session_.path() + ". Continue with: rig resume " + session_.path();
  } catch (const std::exception&) {
    return "";  // The session cannot be read any more; the failure says why.
  }
}

boost::asio::awaitable<void> RunControl::until_aborted() { co_await abort_.wait(); }

boost::asio::awaitable<void> RunControl::until_resumed() { co_await resume_.wait(); }

}  // namespace rig
