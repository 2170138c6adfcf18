// SPDX-License-Identifier: MIT
#include "lidar/clock_estimator.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace lidar {
namespace {

constexpr std::uint32_t timer_mask = 0xFFFFFF;
constexpr double largest_drift = 300e-6;  // crystals stay within 100 ppm; beyond 1 % it is another clock
constexpr double rate_slack_ms = 500;     // what a scan may be late without its clock being accused
constexpr double rate_share = 0.01;
constexpr std::size_t most_exchanges = 400, grid_scans = 400, most_windows = 60;
constexpr double window_ms = 5000;

}  // namespace

std::uint64_t ClockEstimator::unwrap(std::uint32_t stamp_ms, double host_us) {
  if (!seen_) {
    seen_ = true;
    unwrapped_ = stamp_ms;
  } else {
    const std::uint32_t forward = (stamp_ms - static_cast<std::uint32_t>(unwrapped_)) & timer_mask;
    const bool backwards = forward > timer_mask / 2;
    const std::uint32_t back = (timer_mask + 1 - forward) & timer_mask;
    if (backwards && back < 1000) return unwrapped_ - back;  // a late answer, not a new timer
    if (backwards) {
      ++estimate_.resets;
      const double passed_ms = std::max(1.0, (host_us - last_host_us_) / 1000);
      unwrapped_ += static_cast<std::uint64_t>(passed_ms);
      // The timer's low bits must go on matching the device's, so the sum of both is moved to the next such
      // value.
      unwrapped_ += (stamp_ms - static_cast<std::uint32_t>(unwrapped_)) & timer_mask;
      exchanges_.clear();
      grid_.clear();
      envelope_.clear();
      window_open_ = first_seen_ = false;
      anchored_ = estimate_.synchronised = false;
      estimate_.exchanges = 0;
    } else {
      unwrapped_ += forward;
    }
  }
  last_host_us_ = host_us;
  return unwrapped_;
}

void ClockEstimator::add_exchange(double sent_us, double received_us, std::uint64_t device_ms) {
  const double stamp = static_cast<double>(device_ms);
  exchanges_.push_back({stamp, sent_us - 1000, received_us});
  if (exchanges_.size() > most_exchanges) exchanges_.pop_front();
  fit_exchanges();
}

/// The offsets allowed by every exchange at the present drift; where they contradict each other (the drift is
/// not known yet, a time-out in between) the newest win.
void ClockEstimator::fit_exchanges() {
  const double rate = 1000 * (1 - estimate_.drift_ppm * 1e-6), reference = exchanges_.back().device_ms;
  double low = -std::numeric_limits<double>::infinity(), high = std::numeric_limits<double>::infinity();
  int used = 0;
  for (auto exchange = exchanges_.rbegin(); exchange != exchanges_.rend(); ++exchange) {
    const double ahead = rate * (reference - exchange->device_ms);
    const double bound_low = exchange->earliest_us + ahead, bound_high = exchange->latest_us + ahead;
    if (std::max(low, bound_low) > std::min(high, bound_high)) break;
    low = std::max(low, bound_low);
    high = std::min(high, bound_high);
    ++used;
  }
  estimate_.device_ms = reference;
  estimate_.host_us = (low + high) / 2;
  estimate_.offset_u_us = (high - low) / std::sqrt(12.0);  // a uniform distribution between the bounds
  estimate_.exchanges = used;
  estimate_.synchronised = true;
  anchored_ = true;
  const Exchange& oldest = exchanges_.front();
  const double device_us = 1000 * (reference - oldest.device_ms),
               host_us = exchanges_.back().latest_us - oldest.latest_us;
  // Half a second of host time in which the device's clock stood still or ran away: a simulator at full
  // speed.
  if (std::abs(device_us - host_us) > 5000 + 0.2 * host_us + 1000 * rate_slack_ms * (host_us < 20000 ? 1 : 0))
    estimate_.follows_host = false;
}

void ClockEstimator::judge_rate(double device_ms, double arrival_us) {
  if (!first_seen_) {
    first_ = {device_ms, arrival_us};
    first_seen_ = true;
    return;
  }
  if (!estimate_.follows_host) return;
  const double device = device_ms - first_.device_ms, host = (arrival_us - first_.latest_us) / 1000;
  const bool ahead = device > host * (1 + rate_share) + rate_slack_ms;
  const bool behind = host > device * (1 + rate_share) + 20 * rate_slack_ms;
  if (!ahead && !behind) return;
  estimate_.follows_host = false;
  estimate_.device_ms = device_ms;
  // From here on the device's own clock; not before what was said of earlier scans.
  estimate_.host_us = arrival_us;
  anchored_ = true;
}

/// Arrivals are late by at least the same delay: the earliest of each window lie on a line whose slope is the
/// clocks' rate.
void ClockEstimator::note_arrival(double device_ms, double latest_us) {
  const double rate = 1000 * (1 - estimate_.drift_ppm * 1e-6);
  const auto lateness = [&](const Arrival& a) { return a.latest_us - rate * (a.device_ms - device_ms); };
  if (!window_open_) {
    window_open_ = true;
    window_start_ms_ = device_ms;
    best_in_window_ = {device_ms, latest_us};
  } else if (lateness({device_ms, latest_us}) < lateness(best_in_window_)) {
    best_in_window_ = {device_ms, latest_us};
  }
  if (device_ms - window_start_ms_ < window_ms) return;
  envelope_.push_back(best_in_window_);
  window_open_ = false;
  if (envelope_.size() > most_windows) envelope_.pop_front();
  if (envelope_.size() < 4) return;
  // Theil-Sen: the median of the slopes between all pairs shrugs off windows in which every scan was late.
  std::vector<double> slopes;
  for (std::size_t i = 0; i < envelope_.size(); ++i)
    for (std::size_t j = i + envelope_.size() / 2; j < envelope_.size(); ++j)
      slopes.push_back((envelope_[j].latest_us - envelope_[i].latest_us) /
                       (envelope_[j].device_ms - envelope_[i].device_ms));
  const auto middle = slopes.begin() + static_cast<std::ptrdiff_t>(slopes.size() / 2);
  std::nth_element(slopes.begin(), middle, slopes.end());
  const double drift = 1 - *middle / 1000;
  if (std::abs(drift) > largest_drift) return;
  const double moved = estimate_.drift_ppm - drift * 1e6,
               span_ms = envelope_.back().device_ms - envelope_.front().device_ms;
  estimate_.drift_u_ppm =
      std::max(std::abs(moved) / 2, 50 / span_ms * 1000);  // 50 us of jitter over the span
  estimate_.drift_ppm = drift * 1e6;
  if (!exchanges_.empty() && estimate_.follows_host) fit_exchanges();
}

/// The true time of the newest stamp: stamps are the floors of start + k * period. All pairs (start, period)
/// that give the recent stamps form a convex region; its middle for the newest scan is taken.
double ClockEstimator::on_the_grid(double device_ms) {
  if (!grid_.empty()) {
    const double gap = device_ms - grid_.back().device_ms;
    const double period = period_ms_ > 0 ? period_ms_ : nominal_period_ms_;
    const auto scans = static_cast<std::int64_t>(std::llround(gap / period));
    if (gap < 0 || scans < 1 || scans > 100 ||
        std::abs(gap - static_cast<double>(scans) * period) > 2 + 0.01 * gap)
      grid_.clear();
    else
      grid_.push_back({grid_.back().index + scans, device_ms});
  }
  if (grid_.empty()) grid_.push_back({0, device_ms});
  if (grid_.size() > grid_scans) grid_.pop_front();
  if (grid_.size() < 10) return device_ms + 0.5;
  // The steepest and the flattest line that stay above every stamp and below every stamp + 1, by least
  // squares first, then pushed back between the bounds.
  const double n = static_cast<double>(grid_.size()), last = static_cast<double>(grid_.back().index);
  double si = 0, ss = 0, sii = 0, sis = 0;
  for (const Stamp& stamp : grid_) {
    const double i = static_cast<double>(stamp.index) - last, s = stamp.device_ms - device_ms + 0.5;
    si += i;
    ss += s;
    sii += i * i;
    sis += i * s;
  }
  period_ms_ = (n * sis - si * ss) / (n * sii - si * si);
  double low = -1e9, high = 1e9;
  for (const Stamp& stamp : grid_) {
    const double along = period_ms_ * (static_cast<double>(stamp.index) - last),
                 s = stamp.device_ms - device_ms;
    low = std::max(low, s - along);
    high = std::min(high, s + 1 - along);
  }
  // A motor that is not quite steady leaves no line between all bounds; the middle is then still the best.
  return device_ms + std::clamp((low + high) / 2, 0.0, 1.0);
}

double ClockEstimator::to_host(double device_ms) const {
  const double rate = estimate_.follows_host ? 1000 * (1 - estimate_.drift_ppm * 1e-6) : 1000.0;
  return estimate_.host_us + rate * (device_ms - estimate_.device_ms);
}

double ClockEstimator::add_scan(std::uint64_t device_ms, double arrival_us, double scan_ms) {
  const double stamp = static_cast<double>(device_ms), latest_us = arrival_us - 1000 * scan_ms;
  if (!anchored_) {
    estimate_.device_ms = stamp;
    estimate_.host_us = latest_us;
    estimate_.offset_u_us = 1000;
    anchored_ = true;
  }
  judge_rate(stamp, latest_us);
  const double start_ms = on_the_grid(stamp);
  if (!estimate_.follows_host) return to_host(start_ms);
  note_arrival(stamp, latest_us);
  if (!estimate_.synchronised && to_host(stamp) > latest_us) {  // nothing arrives before it was sent
    estimate_.device_ms = stamp;
    estimate_.host_us = latest_us;
  }
  return to_host(start_ms);
}

ClockEstimate ClockEstimator::estimate() const { return estimate_; }

}  // namespace lidar
