// SPDX-License-Identifier: MIT
#include "lidar/device_timer.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "lidar/clock_limits.hpp"

namespace lidar {
namespace {

constexpr std::uint32_t timer_mask = 0xFFFFFF;
constexpr std::uint32_t late_answer_ms = 1000;  // so far back, a stamp is a late answer and no new timer
constexpr double longest_delay_ms = 5000;       // of one stamp, where a stream that stalls was given up
constexpr double longest_absence_ms = 3.6e6;    // from one connection to the next, on a clock of its own

/// Whether a timer that shows so much more than before cannot have run on.
bool cannot_have_run_on(std::uint32_t forward, double passed_ms, bool newly_connected, bool follows_host) {
  if (forward > timer_mask / 2) return true;
  if (!follows_host) return newly_connected && forward > longest_absence_ms;
  // Within a connection a stamp may be early against the one before, by as much as that one was held up.
  const double tolerance_ms =
      rate_tolerance * passed_ms + (newly_connected ? longest_delay_ms : longest_stall_ms);
  return forward > passed_ms + tolerance_ms || (newly_connected && forward < passed_ms - tolerance_ms);
}

/// Hours of silence hide whole turns of the timer: the step that agrees with the host's clock; 0 for none.
std::uint64_t forward_through_silence(std::uint32_t forward, double passed_ms, bool follows_host) {
  if (!follows_host || passed_ms < timer_mask / 4.0) return 0;
  const double turns = std::max(0.0, std::round((passed_ms - forward) / (timer_mask + 1.0)));
  const double device_ms = forward + turns * (timer_mask + 1.0);
  const bool agrees = std::abs(device_ms - passed_ms) < rate_tolerance * passed_ms;
  return agrees ? static_cast<std::uint64_t>(device_ms) : 0;
}

}  // namespace

DeviceTimer::Reading DeviceTimer::unwrap(std::uint32_t stamp_ms, double host_us, bool follows_host) {
  const bool newly_connected = std::exchange(newly_connected_, false);
  bool restarted = false;
  if (!seen_) {
    seen_ = true;
    timer_ms_ = stamp_ms;
  } else {
    const std::uint32_t forward = (stamp_ms - static_cast<std::uint32_t>(timer_ms_)) & timer_mask;
    const std::uint32_t back = (timer_mask + 1 - forward) & timer_mask;
    const double passed_ms = (host_us - last_host_us_) / 1000;
    // Nothing is older than the timer's zero: just after the start, a stamp from before is a new timer's. Nor
    // does a new connection bring answers of an old one.
    if (!newly_connected && forward > timer_mask / 2 && back < late_answer_ms && back <= timer_ms_)
      return {base_ms_ + timer_ms_ - back, false};
    // A timer that started again shows another number than the last, but for one in 16 million: this one
    // stands still, which the scans that follow show as well. It is judged anew when it moves.
    if (newly_connected && forward == 0) {
      newly_connected_ = true;
      return {base_ms_ + timer_ms_, false};
    }
    if (const std::uint64_t turned = forward_through_silence(forward, passed_ms, follows_host); turned > 0) {
      timer_ms_ += turned;
    } else if (cannot_have_run_on(forward, passed_ms, newly_connected, follows_host)) {
      restarted = true;
      ++resets_;
      const std::uint64_t next_ms =
          base_ms_ + timer_ms_ + static_cast<std::uint64_t>(std::llround(std::max(1.0, passed_ms)));
      timer_ms_ = stamp_ms;
      base_ms_ = next_ms - timer_ms_;
    } else {
      timer_ms_ += forward;
    }
  }
  last_host_us_ = host_us;
  return {base_ms_ + timer_ms_, restarted};
}

}  // namespace lidar
