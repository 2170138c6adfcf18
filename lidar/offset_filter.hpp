// SPDX-License-Identifier: MIT
#pragma once

#include <array>

namespace lidar {

/// How far the host's clock is ahead of the lidar's, and how that changes: a Kalman filter.
///
/// State: offset (host minus device, us), rate (us a second, that is ppm), delay (from a scan's start to its
/// arrival at best, us) and wait (the part of the delay that changes slowly with where in the sensor's 1 ms
/// frame the scan ends, us). Exchanges of TM1 measure the offset; the least late scan of a while measures
/// offset + delay + wait. So exchanges say where the clocks stand, and scans carry that on.
class OffsetFilter {
 public:
  OffsetFilter(double delay_us, double u_delay_us);

  /// Time has come to this moment of the lidar's clock, ms. `u_wait_us` is how large the wait may be, and
  /// `wait_s` how long it lasts (0: it stays).
  void advance_to(double device_ms, double u_wait_us, double wait_s);

  /// host - device was measured at the present moment, us.
  void measure_offset(double offset_us, double u_us);
  /// The least late scan came so much later than its start on the lidar's clock, us: innovation first, so
  /// that the caller can judge it.
  struct Innovation {
    double us, u_us;
  };
  [[nodiscard]] Innovation lateness_innovation(double lateness_us, double u_us) const;
  void measure_lateness(double lateness_us, double u_us);
  /// The way to the host may have changed by so much.
  void doubt_delay(double by_us);
  /// From now on lateness is counted from another moment.
  void replace_delay(double delay_us, double u_us);
  /// The offset is not known any more, the rate and the delay are.
  void forget_offset();

  [[nodiscard]] double offset_us(double device_ms) const;
  [[nodiscard]] double u_offset_us(double device_ms) const;
  [[nodiscard]] double delay_us() const { return state_[delay] + state_[wait]; }
  [[nodiscard]] double u_delay_us() const;
  [[nodiscard]] double rate_ppm() const { return state_[rate]; }
  [[nodiscard]] double u_rate_ppm() const;

 private:
  enum { offset, rate, delay, wait, states };
  using Vector = std::array<double, states>;
  void measure(const Vector& how, double value, double u);

  double device_ms_ = 0;
  bool begun_ = false;
  Vector state_{};
  std::array<Vector, states> covariance_{};
};

}  // namespace lidar
