// SPDX-License-Identifier: MIT
#include "lidar/clock_estimator.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

#include "lidar/clock_limits.hpp"

namespace lidar {
namespace {

constexpr double ahead_slack_ms = 100;       // a first scan that was late itself must not accuse the clock
constexpr double behind_slack_ms = 2000;     // nor must a network that stalls
constexpr double exchange_baseline_ms = 30;  // shorter, an exchange's own length tells too little
constexpr double longest_frame_ms = 10, first_sent_within_ms = 5;
// Of the shortest round trip, when all that is known of both ways is that each takes anything up to the same
// bound, whatever that is: then the shorter is in any ratio to the longer, half their difference is below x /
// 2 of their sum with the probability 2 x / (1 + x), and 95 % of it is below 0.4525: two standard
// uncertainties.
constexpr double way_share = 0.226;
constexpr double least_u_offset_us = 3;
constexpr double golden_ratio = 0.6180339887498949;             // its multiples fill a turn evenly
constexpr double delay_beyond_scan_us = 500, u_delay_us = 500;  // 1 ms frame, 6.7 kB at 100 Mbit/s, a queue
constexpr double u_delay_for_window_us = 150;                   // better known, ticks are told apart by it
constexpr double u_delay_known_us = 300;                        // of a device that was followed before
constexpr double earliest_for_window_us = -300;
constexpr double scattered_us = 480;  // mean lateness behind a tick; 720 when there are no ticks
constexpr double held_up_us = 600;    // behind the latest that a scan may wait
constexpr double lost_us =
    1500;  // behind the usual, for each millisecond that scans may wait: more than that
constexpr int lost_believed = 2, whiles_of_usual = 4;
constexpr int scattered_believed = 4, whiles_until_lost = 2;
constexpr double usual_wait_us = 500, u_first_offset_us = 600;  // of a single scan
constexpr double u_completion_us = 150;      // how long a complete scan is worked on before it may leave
constexpr double u_delay_of_stream_us = 30;  // from one stream to the next
constexpr int first_while = 20, longest_while = 80;  // scans
constexpr double longest_while_ms = 5000;
constexpr double outlier = 5, outlier_us = 200;
constexpr double believed = 3;  // standard uncertainties; who is further off is less sure than he says
constexpr int late_whiles_believed = 10, early_whiles_believed = 2;

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

ClockEstimator::ClockEstimator(double nominal_period_ms, double scan_ms, Departure departure)
    : scan_ms_(scan_ms),
      grid_(nominal_period_ms),
      filter_(delay_beyond_scan_us + (departure == Departure::on_tick ? 0 : 1000 * scan_ms), u_delay_us),
      departure_(departure) {}

std::uint64_t ClockEstimator::unwrap(std::uint32_t stamp_ms, double host_us) {
  const DeviceTimer::Reading reading = timer_.unwrap(stamp_ms, host_us, follows_host_);
  if (reading.started_again) start_again();
  return reading.ms;
}

void ClockEstimator::start_again() {
  exchanges_.clear();
  grid_.restart();
  filter_.forget_offset();
  // The delay is known, the offset is not: now it matters which of the timer's ticks a scan left on.
  tick_unknown_ = true;
  filter_.doubt_delay(u_completion_us);
  offset_known_ = synchronised_ = rate_judged_from_ = false;
  u_way_us_ = 0;
  while_.begin();
}

double ClockEstimator::to_host(double device_ms) const {
  if (!follows_host_) return anchor_.host_us + 1000 * (device_ms - anchor_.device_ms);
  return origin_us_ + 1000 * device_ms + filter_.offset_us(device_ms);
}

// --- exchanges
// ------------------------------------------------------------------------------------------------

void ClockEstimator::begin_exchanges() { exchanges_.clear(); }

void ClockEstimator::add_exchange(double sent_us, double received_us, std::uint64_t device_ms) {
  exchanges_.add({static_cast<double>(device_ms), sent_us, received_us});
  // What passed on the host's clock between the first and the last lies between these, whatever the delays.
  const Exchange &first = exchanges_.first(), &last = exchanges_.last();
  const double device = last.device_ms - first.device_ms,
               least = (last.sent_us - first.received_us) / 1000 - longest_frame_ms,
               most = (last.received_us - first.sent_us) / 1000 + longest_frame_ms;
  if (most < exchange_baseline_ms) return;
  if (device * (1 + rate_tolerance) < least || device * (1 - rate_tolerance) > most)
    follow_device({last.device_ms, last.received_us});
}

double ClockEstimator::best_time_to_send(double earliest_us) const {
  const double turns = golden_ratio * static_cast<double>(exchanges_.size());
  if (exchanges_.size() < ExchangeRound::enough)
    return earliest_us + 1000 * first_sent_within_ms * (turns - std::floor(turns));
  const ExchangeRound::Answering how = exchanges_.answering();
  const ExchangeRound::Bounds known = exchanges_.bounds(exchanges_.last().device_ms, how, rate());
  const double tick_us = (known.low_us + known.high_us) / 2, step_us = 1000.0 * how.step_ms;
  double wanted = 0;
  if (how.on_step) {
    // Who is answered on the tick says that he was in time: the last moment at which one still is.
    wanted = known.low_us + (turns - std::floor(turns)) * (known.high_us - known.low_us);
  } else {
    // By turns so that a quick answer was read just behind the tick, and so that it was read just before it.
    wanted = tick_us - exchanges_.shortest_round_trip_us() * (exchanges_.size() % 2 == 0 ? 0.5 : 1.0);
  }
  return wanted + step_us * std::ceil((earliest_us - wanted) / step_us);
}

void ClockEstimator::learn_steps(ExchangeRound::Answering how) {
  frame_ms_ = how.on_step ? how.step_ms : 1;
  coarse_stamps_ = how.step_ms > 1;
  coarse_rest_ms_ = timer_.since_start_ms(static_cast<std::uint64_t>(exchanges_.last().device_ms)) %
                    static_cast<std::uint64_t>(how.step_ms);
  grid_.set_step(how.step_ms);
  coarse_step_ms_ = how.step_ms;
}

void ClockEstimator::end_exchanges() {
  if (exchanges_.empty() || !follows_host_) return;
  const ExchangeRound::Answering how = exchanges_.answering();
  if (how.step_ms != coarse_step_ms_ && exchanges_.size() >= ExchangeRound::enough) learn_steps(how);
  // In the middle of the round the unknown rate does least harm.
  const double device_ms = std::round((exchanges_.first().device_ms + exchanges_.last().device_ms) / 2);
  const ExchangeRound::Bounds known = exchanges_.bounds(device_ms, how, rate());
  const double middle_us = (known.low_us + known.high_us) / 2, width_us = known.high_us - known.low_us;
  if (!offset_known_) {
    origin_us_ = middle_us - 1000 * device_ms;
    filter_.forget_offset();
    offset_known_ = true;
  }
  const double shortest_us = std::min(width_us, exchanges_.shortest_round_trip_us());
  u_way_us_ = way_share * (synchronised_ ? std::min(shortest_us, u_way_us_ / way_share) : shortest_us);
  const double u_us = way_share * width_us;
  filter_.advance_to(device_ms, 0, 0);
  filter_.measure_offset(
      middle_us - 1000 * device_ms - origin_us_,
      std::sqrt(std::max(u_us * u_us - u_way_us_ * u_way_us_, least_u_offset_us * least_u_offset_us)));
  exchanges_used_ = known.used;
  tick_unknown_ = false;
  synchronised_ = true;
}

// --- scans
// ----------------------------------------------------------------------------------------------------

void ClockEstimator::begin_stream() {
  while_.begin();
  learn_usual_lateness();
  whiles_closed_ = late_whiles_ = scattered_whiles_ = lost_whiles_ = 0;
  filter_.doubt_delay(u_delay_of_stream_us);
}

void ClockEstimator::learn_usual_lateness() {
  whiles_for_usual_ = whiles_of_usual;
  usual_late_us_ = std::numeric_limits<double>::infinity();
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
  // Exchanges have said that the clocks agree: then it is the caller who did not read for a while.
  const double ahead_ms = synchronised_ ? longest_stall_ms : ahead_slack_ms,
               behind_ms = synchronised_ ? longest_stall_ms : behind_slack_ms;
  const bool ahead = device > host * (1 + rate_tolerance) + ahead_ms;
  const bool behind = host > device * (1 + rate_tolerance) + behind_ms;
  if (ahead || behind) follow_device({arrival.device_ms, arrival.host_us - 1000 * scan_ms_});
}

double ClockEstimator::add_scan(std::uint64_t device_ms, double arrival_us) {
  const double stamp = static_cast<double>(device_ms);
  if (follows_host_) judge_rate({stamp, arrival_us});
  // One that lay in a buffer until the one before it was read says nothing of when it came.
  const bool lay_waiting = arrival_us - last_arrival_.host_us < 500 * (stamp - last_arrival_.device_ms);
  last_arrival_ = {stamp, arrival_us};
  if (coarse_stamps_ &&
      timer_.since_start_ms(device_ms) % static_cast<std::uint64_t>(coarse_step_ms_) != coarse_rest_ms_) {
    coarse_stamps_ = false;
    grid_.set_step(1);
    learn_usual_lateness();
  }
  const ScanGrid::Start start = grid_.add(device_ms);
  u_start_us_ = 1000 * start.u_ms;
  if (!follows_host_) {
    last_start_ms_ = start.device_ms;
    return to_host(start.device_ms);
  }
  if (!offset_known_) {
    origin_us_ =
        arrival_us - 1000 * (scan_ms_ + start.device_ms) - usual_wait_us * frame_ms_ - delay_beyond_scan_us;
    filter_.forget_offset();
    filter_.advance_to(start.device_ms, 0, 0);
    filter_.measure_offset(0, u_first_offset_us);
    offset_known_ = true;
  }
  if (!lay_waiting) note_lateness(start, device_ms, arrival_us);
  last_start_ms_ = start.device_ms;
  return to_host(start.device_ms);
}

void ClockEstimator::While::begin() {
  of_starts.clear();
  of_stamps.clear();
  phases = 0;
}

/// How far a stamp is behind the frame before it.
double ClockEstimator::behind_frame_ms(std::uint64_t device_ms) const {
  if (frame_ms_ <= 1) return 0;
  const auto frame = static_cast<std::uint64_t>(frame_ms_);
  return static_cast<double>((timer_.since_start_ms(device_ms) + frame - coarse_rest_ms_) % frame);
}

void ClockEstimator::note_lateness(const ScanGrid::Start& start, std::uint64_t stamp_ms, double arrival_us) {
  if (while_.of_starts.empty()) while_.begun_ms = start.device_ms;
  // Behind what the rate of the moment says, which keeps a long while from leaning.
  while_.of_starts.push_back({arrival_us - to_host(start.device_ms), start.device_ms, start.u_ms});
  while_.of_stamps.push_back({arrival_us - to_host(static_cast<double>(stamp_ms) - behind_frame_ms(stamp_ms)),
                              start.device_ms, start.u_ms});
  const double phase = start.device_ms / frame_ms_ - std::floor(start.device_ms / frame_ms_);
  while_.phases |= 1u << std::min(31, static_cast<int>(phase * 32));
  const int enough = std::min(longest_while, first_while << std::min(whiles_closed_, 8));
  if (static_cast<int>(while_.of_starts.size()) >= enough ||
      start.device_ms - while_.begun_ms > longest_while_ms)
    close_while();
}

void ClockEstimator::close_while() {
  ++whiles_closed_;
  const LeastLateness least = least_of(while_.of_starts);
  if (whiles_for_usual_ > 0) {
    --whiles_for_usual_;
    usual_late_us_ = std::min(usual_late_us_, least.us);
  }
  const double beyond_us = least.us - usual_late_us_;
  const double may_wait_ms = frame_ms_ + (coarse_stamps_ ? coarse_step_ms_ : 0);
  lost_whiles_ = std::abs(beyond_us) > lost_us * may_wait_ms ? lost_whiles_ + 1 : 0;
  if (lost_whiles_ >= lost_believed) {
    begin_anew(least.device_ms, beyond_us);
  } else {
    if (departure_ == Departure::on_tick && !tick_unknown_)
      measure_by_ticks();
    else
      measure_by_starts(least);
  }
  while_.begin();
}

/// Scans come milliseconds later or earlier than they did, for seconds: the estimate went astray. What is
/// left is when they came at first.
void ClockEstimator::begin_anew(double device_ms, double beyond_us) {
  const double offset_us = filter_.offset_us(device_ms) + beyond_us;
  const double to_end_us = departure_ == Departure::on_tick ? 0 : 1000 * scan_ms_;
  filter_ = OffsetFilter(to_end_us + delay_beyond_scan_us, u_delay_us);
  filter_.advance_to(device_ms, 0, 0);
  filter_.measure_offset(offset_us, u_first_offset_us);
  tick_unknown_ = true;
  synchronised_ = false;
  late_whiles_ = scattered_whiles_ = lost_whiles_ = 0;
}

/// Folds lateness to one millisecond, so that it begins where the tick is expected, or, while that is not
/// known, behind the longest part of the millisecond in which nothing came.
LeastLateness ClockEstimator::least_behind_tick(std::vector<Lateness>& scans) const {
  for (Lateness& scan : scans) scan.u_start_ms = 0;  // ticks do not depend on it
  // Scans wait for one tick or the next; who comes later was held up, and which tick he left on is not known.
  double first_us = scans.front().us;
  for (const Lateness& scan : scans) first_us = std::min(first_us, scan.us);
  const double most_us = first_us + 1000 * (frame_ms_ + (coarse_stamps_ ? coarse_step_ms_ : 0)) + held_up_us;
  std::erase_if(scans, [&](const Lateness& scan) { return scan.us > most_us; });
  const double predicted = filter_.delay_us(), frame_us = 1000 * frame_ms_;
  const bool lost = late_whiles_ + scattered_whiles_ >= whiles_until_lost;
  double from = predicted + earliest_for_window_us;
  const auto fold = [&] {
    for (Lateness& scan : scans) scan.us -= frame_us * std::floor((scan.us - from) / frame_us);
  };
  if (lost || filter_.u_delay_us() > u_delay_for_window_us) {
    fold();
    std::sort(scans.begin(), scans.end(), [](const Lateness& a, const Lateness& b) { return a.us < b.us; });
    double longest = 0, begins = from;
    for (std::size_t i = 0; i < scans.size(); ++i) {
      const double before = i > 0 ? scans[i - 1].us : scans.back().us - frame_us;
      if (scans[i].us - before <= longest) continue;
      longest = scans[i].us - before;
      begins = scans[i].us;
    }
    from = begins - longest / 2 - frame_us * std::round((begins - predicted) / frame_us);
  }
  fold();
  return least_of(scans);
}

void ClockEstimator::measure_by_ticks() {
  const LeastLateness least = least_behind_tick(while_.of_stamps);
  if (least.excess_us > scattered_us * frame_ms_) {
    if (++scattered_whiles_ >= scattered_believed) give_up_ticks();
    return;
  }
  scattered_whiles_ = 0;
  filter_.advance_to(least.device_ms, 0, 0);
  measure(least);
}

void ClockEstimator::give_up_ticks() {
  departure_ = Departure::unknown;
  filter_.replace_delay(1000 * scan_ms_ + delay_beyond_scan_us, u_delay_us);
}

/// How much of the millisecond a scan waits for is not known, only that it changes as the scans pass through.
void ClockEstimator::measure_by_starts(LeastLateness least) {
  const double gap = largest_gap(while_.phases);
  // How long the scans take to pass through the whole millisecond.
  const double turn = grid_.period_ms() / frame_ms_, advance = std::abs(turn - std::round(turn));
  const double sweep_s = grid_.period_ms() / 1000 / std::max(advance, 1e-3);
  if (departure_ == Departure::on_tick) least.us -= 1000 * scan_ms_;  // what its delay is counted from
  // The least wait is as likely to lie anywhere in what no scan has met; where the delay beyond it is known,
  // that it is half of it in the mean says more than that it is nought at least.
  const bool delay_known = departure_ == Departure::on_tick && filter_.u_delay_us() < u_delay_known_us;
  if (delay_known) least.us -= gap * 500 * frame_ms_;
  filter_.advance_to(least.device_ms, gap * 1000 * frame_ms_ / std::sqrt(12.0), sweep_s);
  measure(least);
}

void ClockEstimator::measure(const LeastLateness& least) {
  const double lateness = least.us + filter_.offset_us(least.device_ms);
  const OffsetFilter::Innovation surprise = filter_.lateness_innovation(lateness, least.u_us);
  double u = least.u_us;
  if (std::abs(surprise.us) > std::max(outlier * surprise.u_us, outlier_us)) {
    // All scans of a while can be late, never early: the way must have become shorter.
    if (++late_whiles_ < (surprise.us > 0 ? late_whiles_believed : early_whiles_believed)) return;
    filter_.doubt_delay(std::abs(surprise.us));
  } else {
    u = std::max(u, std::abs(surprise.us) / believed);
  }
  late_whiles_ = 0;
  filter_.measure_lateness(lateness, u);
}

double ClockEstimator::u_scan_us() const {
  return follows_host_ ? std::hypot(filter_.u_offset_us(last_start_ms_), u_start_us_, u_way_us_)
                       : u_start_us_;
}

ClockEstimate ClockEstimator::estimate() const {
  ClockEstimate out;
  out.synchronised = synchronised_;
  out.follows_host = follows_host_;
  out.exchanges = exchanges_used_;
  out.resets = timer_.resets();
  out.scan_u_us = u_scan_us();
  if (!follows_host_) {
    out.device_ms = anchor_.device_ms;
    out.host_us = anchor_.host_us;
    return out;
  }
  if (!offset_known_) return out;
  out.device_ms = std::max(last_start_ms_, exchanges_.empty() ? 0.0 : exchanges_.last().device_ms);
  out.host_us = to_host(out.device_ms);
  out.offset_u_us = std::hypot(filter_.u_offset_us(out.device_ms), u_way_us_);
  out.drift_ppm = -filter_.rate_ppm();
  out.drift_u_ppm = filter_.u_rate_ppm();
  return out;
}

}  // namespace lidar
