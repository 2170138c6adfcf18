// SPDX-License-Identifier: MIT
#include "lidar/exchange_round.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>

namespace lidar {
namespace {

constexpr std::size_t most_exchanges = 400;
constexpr double longest_step_ms = 10;   // of a timer, or of the moments at which it is answered
constexpr double unknown_rate = 100e-6;  // what exchanges may drift apart within a round

}  // namespace

void ExchangeRound::add(const Exchange& exchange) {
  exchanges_.push_back(exchange);
  if (exchanges_.size() > most_exchanges) exchanges_.pop_front();
}

ExchangeRound::Answering ExchangeRound::answering() const {
  if (exchanges_.size() < enough) return {};
  const Exchange& first = exchanges_.front();
  std::int64_t step_ms = 0;
  for (const Exchange& exchange : exchanges_)
    step_ms = std::gcd(step_ms, std::llround(exchange.device_ms - first.device_ms));
  if (step_ms < 2 || step_ms > longest_step_ms) return {};
  // Who waits for the step with its answer never tells a stamp that was over when he was asked.
  double latest_sent_us = -std::numeric_limits<double>::infinity(), earliest_received_us = -latest_sent_us;
  for (const Exchange& exchange : exchanges_) {
    const double passed_us = 1000 * (exchange.device_ms - first.device_ms),
                 doubt_us = unknown_rate * passed_us;
    latest_sent_us = std::max(latest_sent_us, exchange.sent_us - passed_us - doubt_us);
    earliest_received_us = std::min(earliest_received_us, exchange.received_us - passed_us + doubt_us);
  }
  return {static_cast<int>(step_ms), latest_sent_us < earliest_received_us};
}

ExchangeRound::Bounds ExchangeRound::bounds(double reference, Answering how, const TimerRate& timer) const {
  const double rate = 1000 + timer.ppm / 1000;
  const double doubt = std::min(unknown_rate, 1e-6 * timer.u_ppm);
  const double step_us = how.on_step ? 0 : 1000.0 * how.step_ms;
  Bounds all{-std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity(), 0};
  for (auto exchange = exchanges_.rbegin(); exchange != exchanges_.rend(); ++exchange) {
    const double ahead = rate * (reference - exchange->device_ms);
    const double doubt_us = doubt * std::abs(ahead);
    const double low = exchange->sent_us - step_us + ahead - doubt_us,
                 high = exchange->received_us + ahead + doubt_us;
    if (std::max(low, all.low_us) > std::min(high, all.high_us)) break;
    all.low_us = std::max(low, all.low_us);
    all.high_us = std::min(high, all.high_us);
    ++all.used;
  }
  return all;
}

double ExchangeRound::shortest_round_trip_us() const {
  double shortest_us = std::numeric_limits<double>::infinity();
  for (const Exchange& exchange : exchanges_)
    shortest_us = std::min(shortest_us, exchange.received_us - exchange.sent_us);
  return shortest_us;
}

}  // namespace lidar
