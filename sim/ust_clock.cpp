// SPDX-License-Identifier: MIT
#include "sim/ust_clock.hpp"

#include <algorithm>
#include <cmath>

namespace sim {

UstClock::UstClock(double ppm, double turn_s, std::uint32_t start_ms)
    : first_rate_(1 + ppm * 1e-6), turn_s_(turn_s), offset_ms_(start_ms) {}

double UstClock::stood_s(double time_s) const {
  return stood_before_s_ + std::clamp(time_s - stands_from_s_, 0.0, stands_until_s_ - stands_from_s_);
}

std::uint32_t UstClock::stamp_ms(double time_s) const {
  const double timer_s = counted_s(time_s) - timer_zero_s_ - stood_s(time_s);
  const double device_ms = timer_s * first_rate_ * 1e3;
  // What happens on a tick happens after it: a nanosecond more than rounding takes.
  return static_cast<std::uint32_t>((static_cast<std::int64_t>(std::floor(device_ms + 1e-6)) + offset_ms_) &
                                    0xffffff);
}

double UstClock::turn_begins_s(std::int64_t index) const {
  return when_s(mirror_zero_s_ + static_cast<double>(index) * turn_s_);
}

std::int64_t UstClock::turn_at(double time_s) const {
  return static_cast<std::int64_t>(std::floor((counted_s(time_s) - mirror_zero_s_) / turn_s_));
}

std::int64_t UstClock::turn_from(double time_s) const {
  return static_cast<std::int64_t>(std::ceil((counted_s(time_s) - mirror_zero_s_) / turn_s_));
}

double UstClock::next_frame_s(double time_s, double frame_s) const {
  const double frame = frame_s / first_rate_;
  return when_s(timer_zero_s_ + std::ceil((counted_s(time_s) - timer_zero_s_) / frame) * frame);
}

void UstClock::start(double now_s) {
  zero_timer(now_s);
  mirror_zero_s_ = counted_s(now_s);
}

void UstClock::zero_timer(double now_s) {
  timer_zero_s_ = counted_s(now_s);
  offset_ms_ = 0;
  stood_before_s_ = stands_from_s_ = stands_until_s_ = 0;
}

void UstClock::set_ppm(double now_s, double ppm) {
  base_counted_s_ = counted_s(now_s);
  base_s_ = now_s;
  rate_ = (1 + ppm * 1e-6) / first_rate_;
}

void UstClock::stand(double now_s, double seconds) {
  stood_before_s_ = stood_s(now_s);
  stands_from_s_ = now_s;
  stands_until_s_ = now_s + std::max(0.0, seconds);
}

}  // namespace sim
