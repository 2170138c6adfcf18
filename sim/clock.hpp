// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <limits>

namespace sim {

/// Simulated time since the bench was switched on, shared by the lidar and the stage.
///
/// At a finite speed it follows the host's clock times `speed`. At maximum speed it stands still until
/// somebody who produces data moves it on: the lidar by one scan period with every scan it sends, and the
/// stage a little with every poll while it moves (so that a move ends after a bounded number of polls even
/// when no scan is asked for). Either way it never goes back, and everything stamped with it is consistent.
class SimClock {
 public:
  using Host = std::chrono::steady_clock;
  static constexpr double max_speed = std::numeric_limits<double>::infinity();

  explicit SimClock(double speed = 1) : speed_(speed), started_(Host::now()) {}

  [[nodiscard]] bool is_max() const { return speed_ == max_speed; }
  [[nodiscard]] double speed() const { return speed_; }

  [[nodiscard]] double now_s() const {
    if (is_max()) return moved_s_;
    return std::chrono::duration<double>(Host::now() - started_).count() * speed_;
  }

  /// At maximum speed: time has come this far. Without effect otherwise, or if it is there already.
  void advance_to(double time_s) {
    if (is_max() && time_s > moved_s_) moved_s_ = time_s;
  }

  /// When the host's clock will show that simulated time (now, at maximum speed).
  [[nodiscard]] Host::time_point when(double time_s) const {
    if (is_max()) return Host::now();
    return started_ +
           std::chrono::duration_cast<Host::duration>(std::chrono::duration<double>(time_s / speed_));
  }

 private:
  double speed_;
  Host::time_point started_;
  double moved_s_ = 0;
};

}  // namespace sim
