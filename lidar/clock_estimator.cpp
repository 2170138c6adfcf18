// SPDX-License-Identifier: MIT
#include "lidar/clock_estimator.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace lidar {
namespace {

constexpr std::uint32_t timer_mask = 0xFFFFFF;
constexpr std::uint32_t late_answer_ms = 1000;  // so far back, a stamp is a late answer and no new timer
constexpr double rate_tolerance = 0.01;         // beyond, the lidar's second is no second of the host's
constexpr double ahead_slack_ms = 100;          // a first scan that was late itself must not accuse the clock
constexpr double behind_slack_ms = 2000;        // nor must a network that stalls
constexpr double exchange_baseline_ms = 30;     // shorter, an exchange's own length tells too little
constexpr std::size_t most_exchanges = 400;
constexpr double unknown_rate = 100e-6;  // what exchanges may drift apart within a round
constexpr double delay_beyond_scan_us = 500, u_delay_us = 500;  // 1 ms frame, 6.7 kB at 100 Mbit/s, a queue
constexpr double u_delay_of_stream_us = 30;                     // from one stream to the next
constexpr int first_while = 10, longest_while = 80;             // scans
constexpr double longest_while_ms = 5000;
constexpr double least_u_lateness_us = 4;
constexpr double outlier = 5, outlier_us = 200;
constexpr int late_whiles_believed = 10;

/// The largest part of the millisecond in which no scan began.
double largest_gap(std::uint32_t phases) {
  if (phases == 0) return 1;
  const std::uint32_t turned = std::rotl(phases, std::countl_zero(phases));  // the top bit is set now
  int longest = 0, run = 0;
  for (int bit = 0; bit < 32; ++bit) {
    run = (turned >> bit & 1) != 0 ? 0 : run + 1;
    longest = std::max(longest, run);
  }
  return longest / 32.0;
}

}  // namespace

ClockEstimator::ClockEstimator(double nominal_period_ms, double scan_ms)
    : nominal_period_ms_(nominal_period_ms),
      scan_ms_(scan_ms),
      grid_(nominal_period_ms),
      filter_(1000 * scan_ms + delay_beyond_scan_us, u_delay_us) {}

std::uint64_t ClockEstimator::unwrap(std::uint32_t stamp_ms, double host_us) {
  if (!seen_) {
    seen_ = true;
    unwrapped_ = stamp_ms;
  } else {
    const std::uint32_t forward = (stamp_ms - static_cast<std::uint32_t>(unwrapped_)) & timer_mask;
    const bool backwards = forward > timer_mask / 2;
    const std::uint32_t back = (timer_mask + 1 - forward) & timer_mask;
    if (backwards && back < late_answer_ms) return unwrapped_ - back;
    if (const std::uint64_t turned = forward_through_silence(forward, host_us); turned > 0) {
      unwrapped_ += turned;
    } else if (backwards) {
      ++resets_;
      unwrapped_ += static_cast<std::uint64_t>(std::max(1.0, (host_us - last_host_us_) / 1000));
      // The low bits go on matching the timer's, so that stamps can be compared with what the lidar says.
      unwrapped_ += (stamp_ms - static_cast<std::uint32_t>(unwrapped_)) & timer_mask;
      start_again();
    } else {
      unwrapped_ += forward;
    }
  }
  last_host_us_ = host_us;
  return unwrapped_;
}

/// Hours of silence hide whole turns of the timer: the step that agrees with the host's clock; 0 for none.
std::uint64_t ClockEstimator::forward_through_silence(std::uint32_t forward, double host_us) const {
  const double passed_ms = (host_us - last_host_us_) / 1000;
  if (!follows_host_ || passed_ms < timer_mask / 4.0) return 0;
  const double turns = std::max(0.0, std::round((passed_ms - forward) / (timer_mask + 1.0)));
  const double device_ms = forward + turns * (timer_mask + 1.0);
  const bool agrees = std::abs(device_ms - passed_ms) < rate_tolerance * passed_ms;
  return agrees ? static_cast<std::uint64_t>(device_ms) : 0;
}

void ClockEstimator::start_again() {
  exchanges_.clear();
  grid_.restart();
  filter_.forget_offset();
  offset_known_ = synchronised_ = rate_judged_from_ = false;
  while_ = {};
}

double ClockEstimator::to_host(double device_ms) const {
  if (!follows_host_) return anchor_.host_us + 1000 * (device_ms - anchor_.device_ms);
  return origin_us_ + 1000 * device_ms + filter_.offset_us(device_ms);
}

// --- exchanges
// ------------------------------------------------------------------------------------------------

void ClockEstimator::begin_exchanges() { exchanges_.clear(); }

void ClockEstimator::add_exchange(double sent_us, double received_us, std::uint64_t device_ms) {
  exchanges_.push_back({static_cast<double>(device_ms), sent_us - 1000, received_us});
  if (exchanges_.size() > most_exchanges) exchanges_.pop_front();
  // What passed on the host's clock between the first and the last lies between these, whatever the delays.
  const Exchange &first = exchanges_.front(), &last = exchanges_.back();
  const double device = last.device_ms - first.device_ms, least = (last.earliest_us - first.latest_us) / 1000,
               most = (last.latest_us - first.earliest_us) / 1000;
  if (most < exchange_baseline_ms) return;
  if (device * (1 + rate_tolerance) < least || device * (1 - rate_tolerance) > most)
    follow_device({last.device_ms, last.latest_us});
}

/// What all exchanges allow for the host time of the newest one's millisecond. Where they contradict each
/// other, the newest win.
ClockEstimator::Bounds ClockEstimator::bounds() const {
  const double reference = exchanges_.back().device_ms, rate = 1000 + filter_.rate_ppm() / 1000;
  const double doubt = std::min(unknown_rate, 2e-6 * filter_.u_rate_ppm());
  Bounds all{-std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity(), 0};
  for (auto exchange = exchanges_.rbegin(); exchange != exchanges_.rend(); ++exchange) {
    const double ahead = rate * (reference - exchange->device_ms);
    const double doubt_us = doubt * std::abs(ahead);
    const double low = exchange->earliest_us + ahead - doubt_us,
                 high = exchange->latest_us + ahead + doubt_us;
    if (std::max(low, all.low_us) > std::min(high, all.high_us)) break;
    all.low_us = std::max(low, all.low_us);
    all.high_us = std::min(high, all.high_us);
    ++all.used;
  }
  return all;
}

double ClockEstimator::best_time_to_send(double earliest_us) const {
  if (exchanges_.empty()) return earliest_us;
  const Bounds known = bounds();
  const double tick_us = (known.low_us + known.high_us) / 2;
  double shortest_us = std::numeric_limits<double>::infinity();
  for (const Exchange& exchange : exchanges_)
    shortest_us = std::min(shortest_us, exchange.latest_us - exchange.earliest_us - 1000);
  const double wanted = tick_us - shortest_us / 2;
  return wanted + 1000 * std::ceil((earliest_us - wanted) / 1000);
}

void ClockEstimator::end_exchanges() {
  if (exchanges_.empty() || !follows_host_) return;
  const Bounds known = bounds();
  const double device_ms = exchanges_.back().device_ms, middle_us = (known.low_us + known.high_us) / 2;
  if (!offset_known_) {
    origin_us_ = middle_us - 1000 * device_ms;
    filter_.forget_offset();
    offset_known_ = true;
  }
  filter_.advance_to(device_ms, 0, 0);
  filter_.measure_offset(middle_us - 1000 * device_ms - origin_us_,
                         (known.high_us - known.low_us) / std::sqrt(12.0));
  exchanges_used_ = known.used;
  synchronised_ = true;
}

// --- scans
// ----------------------------------------------------------------------------------------------------

void ClockEstimator::begin_stream() {
  while_ = {};
  whiles_closed_ = late_whiles_ = 0;
  filter_.doubt_delay(u_delay_of_stream_us);
}

void ClockEstimator::follow_device(Moment from) {
  if (!follows_host_) return;
  anchor_ = from;
  // Not before what was said of an earlier scan.
  if (last_start_ms_ > 0) anchor_.host_us = std::max(anchor_.host_us, to_host(last_start_ms_) + 1000);
  follows_host_ = false;
  synchronised_ = false;
}

void ClockEstimator::judge_rate(Moment arrival) {
  if (!rate_judged_from_) {
    rate_from_ = arrival;
    rate_judged_from_ = true;
    return;
  }
  const double device = arrival.device_ms - rate_from_.device_ms,
               host = (arrival.host_us - rate_from_.host_us) / 1000;
  const bool ahead = device > host * (1 + rate_tolerance) + ahead_slack_ms;
  const bool behind = host > device * (1 + rate_tolerance) + behind_slack_ms;
  if (ahead || behind) follow_device({arrival.device_ms, arrival.host_us - 1000 * scan_ms_});
}

double ClockEstimator::add_scan(std::uint64_t device_ms, double arrival_us) {
  const double stamp = static_cast<double>(device_ms);
  if (follows_host_) judge_rate({stamp, arrival_us});
  const ScanGrid::Start start = grid_.add(device_ms);
  u_start_us_ = 1000 * start.u_ms;
  if (!follows_host_) {
    last_start_ms_ = start.device_ms;
    return to_host(start.device_ms);
  }
  if (!offset_known_) {
    origin_us_ = arrival_us - 1000 * (scan_ms_ + stamp) - delay_beyond_scan_us;
    filter_.forget_offset();
    filter_.advance_to(stamp, 0, 0);
    filter_.measure_offset(0, 3 * u_delay_us);
    offset_known_ = true;
  }
  note_lateness(start, arrival_us);
  last_start_ms_ = start.device_ms;
  return to_host(start.device_ms);
}

void ClockEstimator::note_lateness(const ScanGrid::Start& start, double arrival_us) {
  if (while_.scans == 0) {
    while_.begun_ms = start.device_ms;
    while_.lateness_us.fill(std::numeric_limits<double>::infinity());
  }
  ++while_.scans;
  // The rate of the moment keeps a long while from leaning.
  const double late = arrival_us - to_host(start.device_ms);
  if (late < while_.lateness_us[2]) {
    if (late < while_.lateness_us[0]) {
      while_.device_ms = start.device_ms;
      while_.u_start_ms = start.u_ms;
    }
    while_.lateness_us[2] = late;
    std::sort(while_.lateness_us.begin(), while_.lateness_us.end());
  }
  const double phase = start.device_ms - std::floor(start.device_ms);
  while_.phases |= 1u << std::min(31, static_cast<int>(phase * 32));
  const int enough = std::min(longest_while, first_while << std::min(whiles_closed_, 8));
  if (while_.scans >= enough || start.device_ms - while_.begun_ms > longest_while_ms) close_while();
}

/// The least late scan of the while measures the filter's sum of offset, delay and wait.
void ClockEstimator::close_while() {
  const While ended = while_;
  while_ = {};
  ++whiles_closed_;
  const double gap = largest_gap(ended.phases);
  // How long the scans take to pass through the whole millisecond.
  const double turn = grid_.period_ms(), advance = std::abs(turn - std::round(turn));
  const double sweep_s = turn / 1000 / std::max(advance, 1e-3);
  const double lateness = ended.lateness_us[0] + filter_.offset_us(ended.device_ms);
  const double spacing =
      ended.scans >= 3 ? ended.lateness_us[2] - ended.lateness_us[0] : 1000 / std::sqrt(12.0);
  const double u = std::hypot(std::max(spacing, least_u_lateness_us), 1000 * ended.u_start_ms);
  filter_.advance_to(ended.device_ms, gap * 1000 / std::sqrt(12.0), sweep_s);
  const OffsetFilter::Innovation surprise = filter_.lateness_innovation(lateness, u);
  if (std::abs(surprise.us) > std::max(outlier * surprise.u_us, outlier_us)) {
    // All scans of a while can be late, never early: the way must have become shorter.
    if (surprise.us > 0 && ++late_whiles_ < late_whiles_believed) return;
    filter_.doubt_delay(std::abs(surprise.us));
  }
  late_whiles_ = 0;
  filter_.measure_lateness(lateness, u);
}

double ClockEstimator::u_scan_us() const {
  return follows_host_ ? std::hypot(filter_.u_offset_us(last_start_ms_), u_start_us_) : u_start_us_;
}

ClockEstimate ClockEstimator::estimate() const {
  ClockEstimate out;
  out.synchronised = synchronised_;
  out.follows_host = follows_host_;
  out.exchanges = exchanges_used_;
  out.resets = resets_;
  out.scan_u_us = u_scan_us();
  if (!follows_host_) {
    out.device_ms = anchor_.device_ms;
    out.host_us = anchor_.host_us;
    return out;
  }
  if (!offset_known_) return out;
  out.device_ms = std::max(last_start_ms_, exchanges_.empty() ? 0.0 : exchanges_.back().device_ms);
  out.host_us = to_host(out.device_ms);
  out.offset_u_us = filter_.u_offset_us(out.device_ms);
  out.drift_ppm = -filter_.rate_ppm();
  out.drift_u_ppm = filter_.u_rate_ppm();
  return out;
}

}  // namespace lidar
