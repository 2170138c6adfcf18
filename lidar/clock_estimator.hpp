// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <deque>

namespace lidar {

/// How the lidar's clock stands to the host's: host = host_us + (device - device_ms) * 1000 * (1 - drift_ppm
/// * 1e-6).
struct ClockEstimate {
  bool synchronised = false;  ///< From TM exchanges; else only from when scans arrived.
  bool follows_host =
      true;  ///< False when a device second is not a host second within 1 %: a simulator at full speed or a
             ///< broken clock. Scan times then follow the device's clock 1:1 from the anchor.
  double device_ms = 0;    ///< The anchor, device side (24-bit wraps undone).
  double host_us = 0;      ///< The anchor, host side.
  double offset_u_us = 0;  ///< Standard uncertainty of host_us.
  double drift_ppm = 0;    ///< How much faster than the host's the device's clock runs.
  double drift_u_ppm = 0;  ///< Standard uncertainty of drift_ppm.
  int exchanges = 0;       ///< TM exchanges used.
  int resets = 0;          ///< Times the device's timer was found to have started again.
};

/// Relates a lidar's millisecond timer to the host's clock, and each scan to the moment at which its step 0
/// was passed. Pure: the caller says when things happened.
///
/// A TM exchange says: at some moment between sending and receiving, the timer stood in [stamp, stamp + 1
/// ms). Each bounds the offset from both sides; where the stamp's increment falls narrows it far below 1 ms.
/// A scan stamp is the floor of a steady grid of scan starts: the grid that fits all recent floors is known
/// to a few hundredths of a millisecond (the idea of snapping to the grid: urg_stamped; the intersection of
/// bounds in place of a median is ours).
class ClockEstimator {
 public:
  explicit ClockEstimator(double nominal_period_ms = 25) : nominal_period_ms_(nominal_period_ms) {}

  /// The stamp with its 24-bit wraps undone. A timer that started again goes on from where the host's clock
  /// says it would be, and is counted.
  std::uint64_t unwrap(std::uint32_t stamp_ms, double host_us);

  /// One TM1: sent and received by the host's clock.
  void add_exchange(double sent_us, double received_us, std::uint64_t device_ms);

  /// A scan that arrived; returns the host time of its step 0, microseconds. The scan ended `scan_ms` after
  /// step 0 and cannot have arrived before.
  double add_scan(std::uint64_t device_ms, double arrival_us, double scan_ms);

  [[nodiscard]] ClockEstimate estimate() const;

 private:
  struct Exchange {
    double device_ms, earliest_us,
        latest_us;  ///< Bounds of the host time at which the timer showed device_ms.
  };
  struct Stamp {
    std::int64_t index;
    double device_ms;
  };
  struct Arrival {
    double device_ms, latest_us;
  };

  void fit_exchanges();
  void judge_rate(double device_ms, double arrival_us);
  void note_arrival(double device_ms, double latest_us);
  double on_the_grid(double device_ms);
  [[nodiscard]] double to_host(double device_ms) const;

  double nominal_period_ms_;
  ClockEstimate estimate_;
  bool anchored_ = false, seen_ = false;
  std::uint64_t unwrapped_ = 0;
  double last_host_us_ = 0;
  std::deque<Exchange> exchanges_;
  std::deque<Stamp> grid_;
  double period_ms_ = 0;
  Arrival first_{};
  bool first_seen_ = false;
  double window_start_ms_ = 0;
  Arrival best_in_window_{};
  bool window_open_ = false;
  std::deque<Arrival> envelope_;  ///< The earliest arrival of each window: the line they lie on is the clock.
};

}  // namespace lidar
