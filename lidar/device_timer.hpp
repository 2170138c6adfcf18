// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>

namespace lidar {

/// A lidar's 24-bit millisecond timer, its wraps undone. A timer that started again begins a new time base,
/// which goes on from where the host's clock says the old one would be: stamps only go up, and their
/// difference to the timer is constant within a base. A timer that jumps ahead by more than any network can
/// hold back counts as started again.
class DeviceTimer {
 public:
  struct Reading {
    std::uint64_t ms;    ///< On the present time base.
    bool started_again;  ///< Before this stamp.
  };
  /// `host_us`: when the stamp came. `follows_host`: a second of the timer is one of the host's.
  Reading unwrap(std::uint32_t stamp_ms, double host_us, bool follows_host);
  /// The lidar is connected anew: nothing is under way, so that the next stamp says whether the timer ran on.
  void begin_connection() { newly_connected_ = true; }

  /// A stamp of the present base, milliseconds since the timer's start.
  [[nodiscard]] std::uint64_t since_start_ms(std::uint64_t ms) const { return ms - base_ms_; }
  /// Times that it was found to have started again.
  [[nodiscard]] int resets() const { return resets_; }

 private:
  bool seen_ = false, newly_connected_ = false;
  std::uint64_t timer_ms_ = 0;  ///< The newest stamp, wraps undone since the timer's start.
  std::uint64_t base_ms_ = 0;   ///< What is added to it, modulo 2^64.
  double last_host_us_ = 0;
  int resets_ = 0;
};

}  // namespace lidar
