// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/turn_counter.hpp"

#include <algorithm>
#include <cmath>

namespace fit::explain::reduction {

std::int64_t TurnCounter::at(std::int64_t device_ms) {
  // A clock that stands or jumps back tells nothing.
  const std::int64_t since = last_ms_ ? device_ms - *last_ms_ : 0;
  std::int64_t turns = last_ms_ ? 1 : 0;
  if (since > 0 && stated_ms_ > 0) {
    turns = std::max<std::int64_t>(1, std::llround(static_cast<double>(since) / period_ms()));
    counted_ms_ += since;
    counted_ += turns;
  }
  last_ms_ = device_ms;
  return turn_ += turns;
}

/// The motor's own period, once a few seconds tell it better than what the bench states.
double TurnCounter::period_ms() const {
  constexpr std::int64_t resolves_ms = 2000;
  return counted_ms_ > resolves_ms ? static_cast<double>(counted_ms_) / static_cast<double>(counted_)
                                   : stated_ms_;
}

}  // namespace fit::explain::reduction
