// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <deque>

namespace lidar {

/// One TM1: sent and received by the host's clock, and the lidar's stamp in between.
struct Exchange {
  double device_ms, sent_us, received_us;
};

/// How much faster than the host's the lidar's timer runs, as its ticks are long: parts per million.
struct TimerRate {
  double ppm, u_ppm;
};

/// Exchanges that follow each other, without a stream between them: what they say together. Pure.
class ExchangeRound {
 public:
  /// How the lidar answers: its timer's step, and whether it answers when the timer comes to one of them.
  struct Answering {
    int step_ms = 1;
    bool on_step = false;
  };
  struct Bounds {
    double low_us, high_us;
    int used;
  };

  /// So many make it sure how the lidar answers.
  static constexpr std::size_t enough = 10;

  void clear() { exchanges_.clear(); }
  /// The oldest are forgotten.
  void add(const Exchange& exchange);
  [[nodiscard]] bool empty() const { return exchanges_.empty(); }
  [[nodiscard]] std::size_t size() const { return exchanges_.size(); }
  [[nodiscard]] const Exchange& first() const { return exchanges_.front(); }
  [[nodiscard]] const Exchange& last() const { return exchanges_.back(); }

  /// What all stamps have in common. Where they all have the same rest, the lidar either counts in such steps
  /// and answers at once, or it waits with its answer for the next step.
  [[nodiscard]] Answering answering() const;
  /// What all allow for the host time, microseconds, of a moment of the timer, milliseconds. Where they
  /// contradict each other, the newest win.
  [[nodiscard]] Bounds bounds(double reference, Answering how, const TimerRate& timer) const;
  [[nodiscard]] double shortest_round_trip_us() const;

 private:
  std::deque<Exchange> exchanges_;
};

}  // namespace lidar
