// SPDX-License-Identifier: MIT
#include "sim/stage_follower.hpp"

#include <algorithm>

namespace sim {

void follow_stage(double from_s, double now_s, const StageAt& stage_at,
                  const std::function<void(double, const StageMoment&)>& visit) {
  constexpr int steps = 64;
  constexpr double remembered_s = 9;  // the stage forgets what is longer past
  double before_s = std::max(from_s, now_s - remembered_s);
  const double step = (now_s - before_s) / steps;
  if (step <= 0) return;
  StageMoment then = stage_at(before_s);
  for (int i = 0; i < steps; ++i, before_s += step) {
    const StageMoment now = stage_at(before_s + step);
    double time_s = before_s + step;
    if (now.rate_rad_s == 0 && now.angle_rad != then.angle_rad) {
      double moving = before_s;
      for (int halving = 0; halving < 30; ++halving) {
        const double middle = (moving + time_s) / 2;
        const StageMoment at = stage_at(middle);
        (at.rate_rad_s == 0 && at.angle_rad == now.angle_rad ? time_s : moving) = middle;
      }
    }
    visit(time_s, now);
    then = now;
  }
}

void LastMove::follow(double now_s, const StageAt& stage_at) {
  const StageMoment now = stage_at(now_s);
  if (!started_) {
    started_ = true;
    angle_ = now.angle_rad;
  } else if (moving_ || now.angle_rad != angle_ || now.rate_rad_s != 0) {
    follow_stage(seen_s_, now_s, stage_at, [this](double time_s, const StageMoment& moment) {
      if (moment.angle_rad != angle_) {
        approach_ = moment.angle_rad > angle_ ? 1 : -1;
        stopped_s_ = time_s;
      }
      angle_ = moment.angle_rad;
    });
    moving_ = now.rate_rad_s != 0;
  }
  seen_s_ = now_s;
}

}  // namespace sim
