// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <optional>

#include "lidar/scan.hpp"

namespace rig {

class RunClock;

/// The time of a session: microseconds since it was begun. It runs with this computer's steady clock, or,
/// where the lidar's clock has nothing in common with that (a simulator at full speed), with the stamps of
/// the scans that are placed in it.
class SessionClock {
 public:
  /// Begins now. Both clocks are read in the same microseconds: the closest of some pairs.
  explicit SessionClock(const RunClock& clock);

  /// Goes on with a session that was begun at that Unix time.
  void go_on_from(std::int64_t epoch_unix_us);
  /// From now on by the lidar's stamps, or by this computer's clock.
  void follow_lidar(bool lidar);
  /// The lidar may have been switched off meanwhile: the next scan comes now, whatever its stamp.
  void lidar_began_anew() { first_stamp_ms_.reset(); }

  [[nodiscard]] bool follows_lidar() const { return follows_lidar_; }
  /// The Unix time at which the run began.
  [[nodiscard]] std::int64_t begun_unix_us() const { return begun_unix_us_; }
  [[nodiscard]] std::int64_t now_us() const;
  /// Of a moment of this computer's steady clock.
  [[nodiscard]] std::int64_t at_us(std::int64_t host_us) const {
    return host_us - begun_host_us_ + offset_us_;
  }
  /// Of a scan; where the lidar is followed the time goes on to it.
  std::int64_t place_us(const lidar::Scan& scan);

 private:
  const RunClock& clock_;
  std::int64_t begun_host_us_ = 0, begun_unix_us_ = 0, offset_us_ = 0;
  bool follows_lidar_ = false;
  std::optional<std::uint64_t> first_stamp_ms_;
  std::int64_t lidar_now_us_ = 0, at_first_stamp_us_ = 0;
};

}  // namespace rig
