// SPDX-License-Identifier: MIT
#include "rig/runner/session_clock.hpp"

#include <algorithm>
#include <limits>

#include "rig/runner/runner.hpp"

namespace rig {

SessionClock::SessionClock(const RunClock& clock) : clock_(clock) {
  constexpr int readings = 5;
  std::int64_t shortest_us = std::numeric_limits<std::int64_t>::max();
  for (int i = 0; i < readings; ++i) {
    const std::int64_t before_us = clock.host_us(), unix_us = clock.unix_us(), after_us = clock.host_us();
    if (after_us - before_us >= shortest_us) continue;
    shortest_us = after_us - before_us;
    begun_host_us_ = before_us + shortest_us / 2;
    begun_unix_us_ = unix_us;
  }
}

void SessionClock::go_on_from(std::int64_t epoch_unix_us) {
  offset_us_ = std::max<std::int64_t>(0, begun_unix_us_ - epoch_unix_us);
  lidar_now_us_ = offset_us_;
}

void SessionClock::follow_lidar(bool lidar) {
  follows_lidar_ = lidar;
  lidar_now_us_ = at_us(clock_.host_us());
}

std::int64_t SessionClock::now_us() const { return follows_lidar_ ? lidar_now_us_ : at_us(clock_.host_us()); }

std::int64_t SessionClock::place_us(const lidar::Scan& scan) {
  if (!follows_lidar_) return at_us(scan.host_us);
  if (!first_stamp_ms_) {
    first_stamp_ms_ = scan.device_ms;
    at_first_stamp_us_ = lidar_now_us_;
  }
  lidar_now_us_ = at_first_stamp_us_ + 1000 * static_cast<std::int64_t>(scan.device_ms - *first_stamp_ms_);
  return lidar_now_us_;
}

}  // namespace rig
