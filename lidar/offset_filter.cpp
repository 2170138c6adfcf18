// SPDX-License-Identifier: MIT
#include "lidar/offset_filter.hpp"

#include <cmath>

namespace lidar {
namespace {

constexpr double u_offset_unknown_us = 1e9;
constexpr double u_rate_ppm_at_first = 60;  // crystals are good to 50 or 100 ppm
constexpr double rate_wander_ppm = 0.1;     // a root second: 1 ppm in 100 s, as with temperature
constexpr double offset_wander_us = 0.2;    // a root second
constexpr double delay_wander_us = 0.5;     // a root second: queues and schedulers change

double squared(double x) { return x * x; }

}  // namespace

OffsetFilter::OffsetFilter(double delay_us, double u_delay_us) {
  state_[delay] = delay_us;
  covariance_[offset][offset] = squared(u_offset_unknown_us);
  covariance_[rate][rate] = squared(u_rate_ppm_at_first);
  covariance_[delay][delay] = squared(u_delay_us);
}

void OffsetFilter::advance_to(double device_ms, double u_wait_us, double wait_s) {
  const double seconds = begun_ ? (device_ms - device_ms_) / 1000 : 0;
  device_ms_ = device_ms;
  begun_ = true;
  state_[offset] += seconds * state_[rate];
  const double kept = wait_s > 0 ? std::exp(-std::abs(seconds) / wait_s) : 1;
  state_[wait] *= kept;
  Vector* const c = covariance_.data();
  for (int i = 0; i < states; ++i) c[offset][i] += seconds * c[rate][i];
  for (int i = 0; i < states; ++i) c[i][offset] += seconds * c[i][rate];
  for (int i = 0; i < states; ++i) {
    c[wait][i] *= kept;
    c[i][wait] *= kept;
  }
  const double passed = std::abs(seconds);
  c[offset][offset] += squared(offset_wander_us) * passed;
  c[rate][rate] += squared(rate_wander_ppm) * passed;
  c[delay][delay] += squared(delay_wander_us) * passed;
  c[wait][wait] += squared(u_wait_us) * (1 - kept * kept);
}

void OffsetFilter::measure(const Vector& how, double value, double u) {
  Vector gain{};
  double spread = squared(u), expected = 0;
  for (int i = 0; i < states; ++i) {
    for (int j = 0; j < states; ++j) gain[i] += covariance_[i][j] * how[j];
    spread += how[i] * gain[i];
    expected += how[i] * state_[i];
  }
  // Joseph's form would keep the symmetry by itself; with four states it is as cheap to write it back.
  const Vector taken = gain;
  for (double& g : gain) g /= spread;
  for (int i = 0; i < states; ++i) {
    state_[i] += gain[i] * (value - expected);
    for (int j = 0; j < states; ++j) covariance_[i][j] -= gain[i] * taken[j];
  }
  for (int i = 0; i < states; ++i)
    for (int j = 0; j < i; ++j)
      covariance_[i][j] = covariance_[j][i] = (covariance_[i][j] + covariance_[j][i]) / 2;
}

void OffsetFilter::measure_offset(double offset_us, double u_us) {
  Vector how{};
  how[offset] = 1;
  measure(how, offset_us, u_us);
}

OffsetFilter::Innovation OffsetFilter::lateness_innovation(double lateness_us, double u_us) const {
  double spread = squared(u_us);
  for (const int i : {offset, delay, wait})
    for (const int j : {offset, delay, wait}) spread += covariance_[i][j];
  return {lateness_us - state_[offset] - state_[delay] - state_[wait], std::sqrt(spread)};
}

void OffsetFilter::measure_lateness(double lateness_us, double u_us) {
  Vector how{};
  how[offset] = how[delay] = how[wait] = 1;
  measure(how, lateness_us, u_us);
}

void OffsetFilter::doubt_delay(double by_us) { covariance_[delay][delay] += squared(by_us); }

void OffsetFilter::replace_delay(double delay_us, double u_us) {
  for (const int gone : {delay, wait})
    for (int i = 0; i < states; ++i) covariance_[gone][i] = covariance_[i][gone] = 0;
  state_[delay] = delay_us;
  state_[wait] = 0;
  covariance_[delay][delay] = squared(u_us);
}

void OffsetFilter::forget_offset() {
  for (int i = 0; i < states; ++i) covariance_[offset][i] = covariance_[i][offset] = 0;
  covariance_[offset][offset] = squared(u_offset_unknown_us);
  begun_ = false;
}

double OffsetFilter::offset_us(double device_ms) const {
  return state_[offset] + state_[rate] * (device_ms - device_ms_) / 1000;
}

double OffsetFilter::u_offset_us(double device_ms) const {
  const double seconds = (device_ms - device_ms_) / 1000;
  return std::sqrt(covariance_[offset][offset] + 2 * seconds * covariance_[offset][rate] +
                   squared(seconds) * covariance_[rate][rate]);
}

double OffsetFilter::u_delay_us() const { return std::sqrt(covariance_[delay][delay]); }

double OffsetFilter::u_rate_ppm() const { return std::sqrt(covariance_[rate][rate]); }

}  // namespace lidar
