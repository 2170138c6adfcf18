// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>

namespace sim {

/// The crystal of a simulated lidar. Its timer counts it, and its motor is held to it, so that the stamps of
/// a stream stay as far apart as they were, however fast the crystal runs: seen from outside, both drift
/// together. The timer's count can be set and can stand; the mirror turns on.
///
/// Times are simulated seconds. A change of rate holds for what comes after it; moments before it are taken
/// at the new rate too, which for the one scan that is under way then is wrong by 25 ms of the difference.
class UstClock {
 public:
  /// `ppm`: how much the crystal is fast at first. `turn_s`: one turn of the mirror then. `start_ms`: what
  /// the timer shows at power-on.
  UstClock(double ppm, double turn_s, std::uint32_t start_ms);

  /// What the timer shows at that time: milliseconds, 24 bits.
  [[nodiscard]] std::uint32_t stamp_ms(double time_s) const;
  /// When turn `index` of the mirror since power-on begins.
  [[nodiscard]] double turn_begins_s(std::int64_t index) const;
  /// The turn under way at that time.
  [[nodiscard]] std::int64_t turn_at(double time_s) const;
  /// The first turn that begins at that time or later.
  [[nodiscard]] std::int64_t turn_from(double time_s) const;
  /// The first moment not before that time at which the timer has counted whole frames of so many seconds.
  [[nodiscard]] double next_frame_s(double time_s, double frame_s) const;

  /// Power-on: timer and mirror begin.
  void start(double now_s);
  /// RS: the timer begins anew, the mirror turns on.
  void zero_timer(double now_s);
  void set_ppm(double now_s, double ppm);
  void shift_ms(std::int64_t by) { offset_ms_ += by; }
  void wrap_in_ms(double now_s, std::int64_t ms) { offset_ms_ += 0x1000000 - ms - stamp_ms(now_s); }
  /// The timer stands for so long, and then goes on from where it stood.
  void stand(double now_s, double seconds);

 private:
  /// The crystal's time, in seconds at its first rate.
  [[nodiscard]] double counted_s(double time_s) const { return base_counted_s_ + (time_s - base_s_) * rate_; }
  [[nodiscard]] double when_s(double counted_s) const {
    return base_s_ + (counted_s - base_counted_s_) / rate_;
  }
  [[nodiscard]] double stood_s(double time_s) const;

  double first_rate_, turn_s_;
  double rate_ = 1, base_s_ = 0, base_counted_s_ = 0;  ///< Of the crystal, against its first rate.
  double timer_zero_s_ = 0, mirror_zero_s_ = 0;        ///< On the crystal.
  double stands_from_s_ = 0, stands_until_s_ = 0, stood_before_s_ = 0;
  std::int64_t offset_ms_;
};

}  // namespace sim
