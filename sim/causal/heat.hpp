// SPDX-License-Identifier: MIT
#pragma once

#include "sim/world.hpp"

namespace sim::causal {

/// Electronics and housing as two lumps that warm themselves, in a room whose temperature they follow with
/// the housing's time constant. Warm-up of hobby and industrial 2D lidars over tens of minutes: Ye and
/// Borenstein 2002 (LMS 200), Kneip et al. 2009 (URG-04LX).
class Heat {
 public:
  explicit Heat(const World::Heat& settings) : settings_(settings) {}

  /// Brings the state to `time_s` since power-on; the room has been at `room_c` since the last call.
  void advance(double time_s, double room_c);

  /// Somebody kept the room at `room_c` for a while that the scans' clock does not count.
  void hold(double room_c, double for_s);

  /// Temperature of the electronics, degrees Celsius.
  [[nodiscard]] double electronics_c() const { return room_ + fast_ + slow_; }
  /// ns by which every echo is late.
  [[nodiscard]] double delay_ns() const {
    return 1e-3 * settings_.delay_ps_per_k * (electronics_c() - settings_.reference_c);
  }
  [[nodiscard]] double gain() const {
    return 1 - settings_.gain_per_k * (electronics_c() - settings_.reference_c);
  }

 private:
  World::Heat settings_;
  double time_ = 0, fast_ = 0, slow_ = 0, room_ = 0;
  bool started_ = false;
};

}  // namespace sim::causal
