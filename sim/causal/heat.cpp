// SPDX-License-Identifier: MIT
#include "sim/causal/heat.hpp"

#include <algorithm>
#include <cmath>

namespace sim::causal {

void Heat::advance(double time_s, double room_c) {
  if (!started_) room_ = room_c;
  started_ = true;
  if (time_s < time_) {  // switched off and on again, after it had cooled
    time_ = fast_ = slow_ = 0;
    room_ = room_c;
  }
  const double dt = time_s - time_;
  time_ = time_s;
  const double fast = 1 - std::exp(-dt / settings_.fast_s), slow = 1 - std::exp(-dt / settings_.slow_s);
  fast_ += (settings_.rise_fast_k - fast_) * fast;
  slow_ += (settings_.rise_slow_k - slow_) * slow;
  room_ += (room_c - room_) * slow;
}

void Heat::hold(double room_c, double for_s) {
  if (started_) room_ += (room_c - room_) * (1 - std::exp(-for_s / settings_.slow_s));
}

}  // namespace sim::causal
