// SPDX-License-Identifier: MIT
#pragma once

#include <functional>

#include "sim/engine.hpp"

namespace sim {

using StageAt = std::function<StageMoment(double time_s)>;

/// What the stage did between two looks at it: engines are called once a scan, and moves happen in between.
/// Calls `visit` with moments in order of time; a stop is visited at the moment it happened.
void follow_stage(double from_s, double now_s, const StageAt& stage_at,
                  const std::function<void(double time_s, const StageMoment&)>& visit);

/// The sign of the last move, and when it ended.
class LastMove {
 public:
  void follow(double now_s, const StageAt& stage_at);
  [[nodiscard]] int approach() const { return approach_; }
  [[nodiscard]] double since_s(double time_s) const { return time_s - stopped_s_; }

 private:
  bool started_ = false, moving_ = false;
  double angle_ = 0, seen_s_ = 0, stopped_s_ = -1e6;
  int approach_ = 0;
};

}  // namespace sim
