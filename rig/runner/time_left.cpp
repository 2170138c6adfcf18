// SPDX-License-Identifier: MIT
#include "rig/runner/time_left.hpp"

#include <algorithm>

namespace rig {
namespace {

constexpr double believed_after_s =
    20;  // Planned: shorter experience is mixed with what was believed before.

}  // namespace

TimeLeft::TimeLeft(const std::vector<PlannedStep>& plan) : plan_(plan) {
  for (const PlannedStep& step : plan) {
    paces_[step.step->kind].ahead_s += step.seconds;
    planned_s_ += step.seconds;
  }
}

void TimeLeft::over(std::size_t step) {
  paces_[plan_[step].step->kind].ahead_s -= plan_[step].seconds;
  over_s_ += plan_[step].seconds;
}

void TimeLeft::over(const Running& finished) {
  over(finished.step);
  Pace& pace = paces_[plan_[finished.step].step->kind];
  pace.planned_s += (1 - finished.from) * plan_[finished.step].seconds;
  pace.took_s += finished.passed_s;
}

void TimeLeft::again(std::size_t step) {
  paces_[plan_[step].step->kind].ahead_s += plan_[step].seconds;
  over_s_ -= plan_[step].seconds;
}

double TimeLeft::left_s(const Running& now) const {
  const double planned_s = plan_[now.step].seconds, done = std::max(now.from, now.done);
  double devices_planned_s = 0, devices_took_s = 0;
  for (const auto& [kind, pace] : paces_)
    if (!kind->asks_a_person()) devices_planned_s += pace.planned_s, devices_took_s += pace.took_s;
  const double of_devices = ratio(devices_planned_s, devices_took_s, 1);
  double left_s = 0;
  for (const auto& [kind, pace] : paces_) {
    const double believed = kind->asks_a_person() ? 1 : of_devices;
    if (kind != plan_[now.step].step->kind) {
      left_s += pace.ahead_s * ratio(pace.planned_s, pace.took_s, believed);
      continue;
    }
    // What runs counts as experience as far as it is done; before, it is what is left that shrinks.
    const bool shows = done > now.from;
    const double own = ratio(pace.planned_s + (done - now.from) * planned_s,
                             pace.took_s + (shows ? now.passed_s : 0), believed);
    left_s += own * (pace.ahead_s - planned_s) +
              std::max(0.0, own * (1 - done) * planned_s - (shows ? 0 : now.passed_s));
  }
  return std::max(0.0, left_s);
}

double TimeLeft::share(const Running& now) const {
  if (!(planned_s_ > 0)) return 0;
  return std::clamp((over_s_ + std::max(now.from, now.done) * plan_[now.step].seconds) / planned_s_, 0.0,
                    1.0);
}

double TimeLeft::ratio(double planned_s, double took_s, double otherwise) {
  if (!(planned_s > 0)) return otherwise;
  const double own = std::min(1.0, planned_s / believed_after_s);
  return own * took_s / planned_s + (1 - own) * otherwise;
}

}  // namespace rig
