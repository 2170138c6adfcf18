// SPDX-License-Identifier: MIT
#pragma once

#include <string>

#include "rig/endpoint.hpp"
#include "rig/stage_factory.hpp"

namespace rig {

/// A second process that waits for this one to die. No stage language has a watchdog of its own, so when the
/// run ends without having said so (killed, crashed, out of memory), this process stops the stage and
/// switches the lidar's laser off.
///
/// It also holds the bench: a second run on the same stage is refused, and one that is started while the
/// watchdog of a killed run still makes the bench safe waits for it.
///
/// Make it before anything opens a port or a file and before any thread is started: it forks.
class Watchdog {
 public:
  /// Throws UsageError when another run holds the stage.
  Watchdog(const Endpoint& lidar, const std::string& stage_url, const StageOptions& stage);
  /// The run has made the bench safe itself.
  ~Watchdog();
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

 private:
  int lock_ = -1, farewell_ = -1;
  int process_ = -1;
};

}  // namespace rig
