// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>

#include "lidar/clock_estimator.hpp"

namespace clock_world {

/// A lidar whose timer runs a little fast or slow, whose motor turns evenly but at a speed of its own, and a
/// network that delays at random. All times on the host's clock.
struct Scenario {
  double period_ms = 25.05;    ///< True time of one turn.
  double drift_ppm = 50;       ///< How fast the timer is.
  double drift_swing_ppm = 0;  ///< And how much that swings, over two minutes.
  double wander_us = 0;        ///< Each turn's random error.
  double delay_us = 150;       ///< Mean random delay each way, on top of the least.
  double least_up_us = 40, least_down_us = 40;
  double most_way_us = 0;  ///< Above 0, for many lidars: each way's least is anything up to this.
  double hiccup_probability = 0.01, hiccup_us = 5000;
  double frame_ms = 1;  ///< Answers and scans leave when the timer has come to a multiple of this ...
  bool stamps_in_frames = false;  ///< ... or it counts in steps of this, and answers at once.
  double busy_share = 0;  ///< Of the time, in spells of a second or two: nothing is read or sent in time.
  bool on_tick = true;    ///< Scans leave on the timer's next millisecond, else as soon as they are complete.
  int scans = 10000;      ///< One capture.
  int exchanges = 150;
  bool synchronise = true;
  std::uint32_t timer_ms = 0;  ///< When the run begins; 0: any.
  int stalls_at = -1;          ///< From that scan on the host does not read for four seconds.
  int reboot_at = -1;          ///< Before that scan the timer starts again from 0, a second later.
};

struct Outcome {
  double rms_us = 0, worst_us = 0, mean_us = 0;
  double converged_rms_us = 0;  ///< Without the first two seconds.
  double late_rms_us = 0;       ///< Without the first twenty.
  double covered = 0;           ///< Share of scans within two stated standard uncertainties.
  double stated_us = 0;
  bool in_order = true;  ///< Unwrapped stamps and host times always went up.
  lidar::ClockEstimate estimate;
};

class World {
 public:
  World(const Scenario& scenario, unsigned seed) : s_(scenario), random_(seed) {
    start_us_ = uniform(1e6, 1e9);
    timer_ms_ = s_.timer_ms > 0 ? s_.timer_ms : uniform(0, 1e6);
  }

  Outcome run() {
    using Departure = lidar::ClockEstimator::Departure;
    lidar::ClockEstimator clock(25, 18.75, s_.on_tick ? Departure::on_tick : Departure::unknown);
    double now = start_us_;
    if (s_.synchronise) now = exchange(clock, now);
    clock.begin_stream();
    Outcome out;
    double begin = now + uniform(0, 25000), last_arrival = 0, last_host = 0;
    std::uint64_t last_stamp = 0;
    int converged = 0, late = 0;
    for (int i = 0; i < s_.scans; ++i) {
      if (i == s_.reboot_at) {
        begin += 1e6;
        timer_ms_ -= timer_ms(begin) - 10;
        clock.begin_stream();
      }
      const double true_start = begin + s_.wander_us * std::normal_distribution<>()(random_);
      begin += 1000 * s_.period_ms;
      double leaves = true_start + 750 * s_.period_ms;
      if (s_.on_tick) leaves = next_frame_us(leaves, s_.stamps_in_frames ? 1 : s_.frame_ms);
      last_arrival = std::max(last_arrival, held_up(leaves + delay(s_.least_down_us + wire_us)));
      if (i == s_.stalls_at) last_arrival += 4e6;
      const std::uint64_t unwrapped = clock.unwrap(stamp(true_start), last_arrival);
      const double host = clock.add_scan(unwrapped, last_arrival);
      out.in_order = out.in_order && (i == 0 || (unwrapped > last_stamp && host > last_host));
      last_stamp = unwrapped;
      last_host = host;
      const double error = host - true_start;
      out.rms_us += error * error / s_.scans;
      if (i >= settling) {
        out.converged_rms_us += error * error;
        ++converged;
      }
      if (i >= seen_for_long) {
        out.late_rms_us += error * error;
        ++late;
      }
      out.mean_us += error / s_.scans;
      out.worst_us = std::max(out.worst_us, std::abs(error));
      out.covered += std::abs(error) <= 2 * clock.u_scan_us() ? 1.0 / s_.scans : 0;
      out.stated_us += clock.u_scan_us() / s_.scans;
    }
    out.rms_us = std::sqrt(out.rms_us);
    out.converged_rms_us = std::sqrt(out.converged_rms_us / std::max(1, converged));
    out.late_rms_us = std::sqrt(out.late_rms_us / std::max(1, late));
    out.estimate = clock.estimate();
    return out;
  }

 private:
  static constexpr double wire_us = 540;  ///< 6,717 bytes at 100 Mbit/s.
  static constexpr int settling = 80, seen_for_long = 800;

  [[nodiscard]] double timer_ms(double host_us) const {
    const double t = (host_us - start_us_) / 1000, turn_ms = 120e3 / (2 * M_PI);
    return timer_ms_ + t * (1 + s_.drift_ppm * 1e-6) +
           s_.drift_swing_ppm * 1e-6 * turn_ms * (1 - std::cos(t / turn_ms));
  }
  [[nodiscard]] std::uint32_t stamp(double host_us) const {
    const double step_ms = s_.stamps_in_frames ? s_.frame_ms : 1;
    const double counted = step_ms * std::floor(timer_ms(host_us) / step_ms + 1e-7);
    return static_cast<std::uint32_t>(static_cast<std::uint64_t>(counted) & 0xFFFFFF);
  }
  /// When the timer next comes to a multiple of the frame.
  [[nodiscard]] double next_frame_us(double host_us, double frame_ms) const {
    const double frame = frame_ms * std::ceil(timer_ms(host_us) / frame_ms);
    for (int i = 0; i < 3; ++i) host_us += 1000 * (frame - timer_ms(host_us));
    return host_us;
  }
  /// The moment at which a busy host gets round to what happened: other programs hold it up for some
  /// milliseconds.
  double held_up(double host_us) {
    if (s_.busy_share <= 0) return host_us;
    while (host_us >= spell_ends_us_) {
      busy_ = uniform(0, 1) < s_.busy_share;
      spell_ends_us_ =
          std::max(spell_ends_us_, start_us_) + std::exponential_distribution<>(1 / 1.5e6)(random_);
    }
    return busy_ && uniform(0, 1) < 0.7 ? host_us + uniform(0, 4000) : host_us;
  }
  double delay(double least) {
    double d = least + std::exponential_distribution<>(1 / s_.delay_us)(random_);
    if (uniform(0, 1) < s_.hiccup_probability) d += s_.hiccup_us * uniform(0, 1);
    return d;
  }
  double uniform(double a, double b) { return std::uniform_real_distribution<>(a, b)(random_); }

  /// As Client::synchronise does it: timers wake late, by up to 90 us around what is expected.
  double exchange(lidar::ClockEstimator& clock, double now) {
    clock.begin_exchanges();
    for (int i = 0; i < s_.exchanges; ++i) {
      const double wanted = clock.best_time_to_send(now + 150);
      const double sent = held_up(wanted + uniform(-30, 60));
      double read = held_up(sent) + delay(s_.least_up_us);
      if (s_.frame_ms > 1 && !s_.stamps_in_frames) read = next_frame_us(read, s_.frame_ms);
      const double received = held_up(read + delay(s_.least_down_us));
      clock.add_exchange(sent, received, clock.unwrap(stamp(read), received));
      now = received;
    }
    clock.end_exchanges();
    return now;
  }

  Scenario s_;
  std::mt19937 random_;
  double start_us_, timer_ms_;
  bool busy_ = false;
  double spell_ends_us_ = 0;
};

struct Summary {
  double rms_us = 0, converged_rms_us = 0, late_rms_us = 0, worst_rms_us = 0, covered = 0, stated_us = 0;
  bool in_order = true;
};

/// Many lidars: motors are off by up to 0.2 %, crystals by up to 100 ppm (scip.md).
template <class See>
Summary over_seeds(const Scenario& base, unsigned seeds, See see) {
  Summary all;
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    std::mt19937 random(seed * 7919);
    Scenario s = base;
    s.period_ms = std::uniform_real_distribution<>(24.95, 25.05)(random);
    s.drift_ppm = std::uniform_real_distribution<>(-100, 100)(random);
    if (base.most_way_us > 0) {
      s.least_up_us = std::uniform_real_distribution<>(0, base.most_way_us)(random);
      s.least_down_us = std::uniform_real_distribution<>(0, base.most_way_us)(random);
    }
    const Outcome one = World(s, seed).run();
    all.rms_us += one.rms_us * one.rms_us / seeds;
    all.converged_rms_us += one.converged_rms_us * one.converged_rms_us / seeds;
    all.late_rms_us += one.late_rms_us * one.late_rms_us / seeds;
    all.worst_rms_us = std::max(all.worst_rms_us, one.rms_us);
    all.covered += one.covered / seeds;
    all.stated_us += one.stated_us / seeds;
    all.in_order = all.in_order && one.in_order;
    see(seed, s, one);
  }
  all.rms_us = std::sqrt(all.rms_us);
  all.converged_rms_us = std::sqrt(all.converged_rms_us);
  all.late_rms_us = std::sqrt(all.late_rms_us);
  return all;
}

}  // namespace clock_world
