// SPDX-License-Identifier: MIT
#pragma once

#include <string>

namespace rig {

/// Stops the stage when this program dies or hangs: none of the stages' languages has a watchdog of its own.
/// A small child process holds the port too; it sends the stop command when the pipe to its parent closes
/// without a farewell (killed, crashed), or when the parent said that the stage moves and then says nothing
/// for `patience_s`.
///
/// It cannot help when the computer itself goes: that is what soft limits are for.
class StageGuard {
 public:
  /// `port`: an open descriptor of the line. Without a child process (no memory, too many processes) it
  /// guards nothing; is_on() tells.
  StageGuard(int port, const std::string& stop_bytes, double patience_s = 5);
  /// Says farewell; nothing is sent to the stage.
  ~StageGuard();
  StageGuard(const StageGuard&) = delete;
  StageGuard& operator=(const StageGuard&) = delete;

  [[nodiscard]] bool is_on() const { return pipe_ >= 0; }
  /// The stage moves, and this program is alive: to be repeated.
  void moving() noexcept { report('m'); }
  void standing() noexcept { report('s'); }

 private:
  void report(char what) noexcept;
  int pipe_ = -1;
  int child_ = -1;
};

}  // namespace rig
