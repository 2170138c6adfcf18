// SPDX-License-Identifier: MIT
#include "rig/runner/stage_motion.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "rig/runner/failures.hpp"

namespace rig {

using boost::asio::awaitable;

namespace {

// As long as a lidar is waited for: both hang on the same plug, and a USB adapter takes seconds to return.
constexpr double longest_absence_s = 30;
constexpr double first_reopen_pause_s = 0.5, longest_reopen_pause_s = 5;

}  // namespace

std::string in_deg(double deg) { return rounded_text(deg, 4) + " deg"; }

double StageMotion::room_deg(double rate_deg_s) const {
  if (!(rate_deg_s > 0 ? limits_.has_max() : limits_.has_min()))
    return std::numeric_limits<double>::infinity();
  return rate_deg_s > 0 ? limits_.max_deg - position_deg_ : position_deg_ - limits_.min_deg;
}

void StageMotion::describe(fit::CaptureInfo& capture) const {
  capture.stage_rad = position_deg_ * fit::rad_per_deg;
  capture.stage_readback_rad = readback_deg_ * fit::rad_per_deg;
  capture.approach = approach_;
}

void StageMotion::stands_at(double deg) { status_.state().stage_deg = position_deg_ = deg; }

awaitable<void> StageMotion::find() {
  const StageStatus now = co_await stage_.status();
  stands_at(now.position_deg);
  referenced_ = now.homed;
  if (now.moving) {
    status_.note("warning", "the stage was found moving and was stopped");
    co_await stop_turning_once();
  }
  for (const auto& warning : now.warnings) status_.note(now.homed ? "warning" : "info", "stage: " + warning);
}

awaitable<void> StageMotion::home(bool again) {
  for (int attempt = 1;; ++attempt) {
    std::exception_ptr why;
    try {
      co_await home_once(again);
      co_return;
    } catch (...) {
      why = std::current_exception();
    }
    control_.stop_if_aborted();
    if (attempt >= stage_attempts || !is_stage_error(why)) std::rethrow_exception(why);
    status_.note("warning", "stage: " + sentence(why) + " It is homed again.");
    co_await recover(attempt, is_stage_lost(why));
  }
}

awaitable<void> StageMotion::home_once(bool again) {
  const StageStatus before = co_await stage_.status();
  if (!before.homed || again) {
    status_.doing("homing");
    co_await stage_.home();
    status_.note("info", "stage homed");
    const StageStatus after = co_await stage_.status();
    stands_at(after.position_deg);
    for (const auto& warning : after.warnings) status_.note("warning", "stage: " + warning);
  } else {
    stands_at(before.position_deg);
  }
  referenced_ = true;
  approach_ = 0;
  settled_us_ = clock_.host_us();
}

void StageMotion::check_soft_limits(double target_deg, const FilePosition& written_at) const {
  if (target_deg < limits_.min_deg - 1e-9 || target_deg > limits_.max_deg + 1e-9 ||
      !std::isfinite(target_deg))
    throw ProcedureError(written_at, "the stage would go to " + in_deg(target_deg) +
                                         ", beyond its soft limits " + to_text(limits_.min_deg) + " to " +
                                         to_text(limits_.max_deg) +
                                         " deg (stage.limits_deg in the bench file). Nothing was moved.");
}

awaitable<double> StageMotion::move_to(double target_deg, int approach, const FilePosition& written_at) {
  check_soft_limits(target_deg, written_at);
  control_.stop_if_aborted();
  const bool stands_there =
      target_deg == position_deg_ && settled_us_ != 0 && (approach == 0 || approach_ == approach);
  if (stands_there) co_return readback_deg_;
  status_.doing("moving to " + in_deg(target_deg));
  for (int attempt = 1;; ++attempt) {
    if (approach != 0 && (approach_ != approach || (target_deg - position_deg_) * approach <= 0)) {
      const double run_up_deg =
          std::clamp(target_deg - approach * rules_.margin_deg, limits_.min_deg, limits_.max_deg);
      co_await drive_to(run_up_deg);
    }
    readback_deg_ = co_await drive_to(target_deg);
    // After a recovery on the way the last move may have come from the wrong side.
    const bool right_side = approach == 0 || approach_ == approach || attempt >= stage_attempts;
    if (std::abs(readback_deg_ - target_deg) <= rules_.tolerance_deg) {
      if (right_side) break;
      continue;
    }
    const std::string seen =
        "The stage was sent to " + in_deg(target_deg) + " and reads back " + in_deg(readback_deg_);
    if (attempt >= stage_attempts)
      throw StageError(seen + ", " + std::to_string(attempt) +
                       " times. It was stopped. Check that nothing blocks it and that its scale is right "
                       "(stage in the bench file).");
    status_.note("warning", seen + "; the move is repeated");
    approach_ = 0;
  }
  if (rules_.settle_s > 0) {
    co_await clock_.sleep(rules_.settle_s);
  }
  settled_us_ = clock_.host_us();
  co_return readback_deg_;
}

awaitable<double> StageMotion::drive_to(double target_deg) {
  for (int attempt = 1;; ++attempt) {
    control_.stop_if_aborted();
    std::exception_ptr why;
    try {
      const double arrived_deg = co_await stage_.move_to(target_deg);
      approach_ = target_deg > position_deg_ ? 1 : target_deg < position_deg_ ? -1 : approach_;
      stands_at(target_deg);
      co_return arrived_deg;
    } catch (...) {
      why = std::current_exception();
    }
    control_.stop_if_aborted();
    if (attempt >= stage_attempts) std::rethrow_exception(why);
    status_.note("warning", "stage: " + sentence(why) + " The rig tries again.");
    co_await recover(attempt, is_stage_lost(why));
  }
}

awaitable<void> StageMotion::recover(int attempt, bool link_lost) {
  co_await clock_.sleep(0.5 * attempt);
  approach_ = 0;
  std::exception_ptr why;
  if (link_lost) co_await reopen();
  try {
    co_await stage_.stop();
    const StageStatus now = co_await stage_.status();
    stands_at(now.position_deg);
    if (!now.homed && !rules_.unhomed) {
      status_.note("warning", "the stage has lost its reference and is homed again");
      co_await home_once(true);
    }
  } catch (...) {
    why = std::current_exception();
  }
  control_.stop_if_aborted();
  if (why) status_.note("warning", "stage: " + words_of(why));
}

awaitable<void> StageMotion::reopen() {
  const std::int64_t begun_us = clock_.host_us();
  for (double pause_s = first_reopen_pause_s;; pause_s = std::min(2 * pause_s, longest_reopen_pause_s)) {
    std::exception_ptr why;
    try {
      co_await stage_.reopen();
      co_return;
    } catch (...) {
      why = std::current_exception();
    }
    control_.stop_if_aborted();
    if (!is_stage_error(why)) std::rethrow_exception(why);
    // A port that returns may at first be forbidden, or held by what greets new devices.
    const double left_s = longest_absence_s - static_cast<double>(clock_.host_us() - begun_us) / 1e6;
    if (left_s <= 0)
      throw StageError(sentence(why) + " The rig waited " + rounded_text(longest_absence_s, 0) +
                       " s for it.");
    if (pause_s == first_reopen_pause_s)
      status_.note("warning", "waiting for the stage: " + sentence(why) + " The rig keeps trying for " +
                                  rounded_text(longest_absence_s, 0) + " s; Ctrl-C stops.");
    co_await clock_.sleep(std::min(pause_s, left_s));
  }
}

awaitable<void> StageMotion::turn(double rate_deg_s) {
  control_.stop_if_aborted();
  status_.doing("turning at " + to_text(rate_deg_s) + " deg/s");
  co_await stage_.turn(rate_deg_s);
}

awaitable<double> StageMotion::turned_to() {
  const StageStatus now = co_await stage_.status();
  if (now.position_deg < limits_.min_deg || now.position_deg > limits_.max_deg)
    throw MeasurementError("The turning stage passed its soft limits at " + in_deg(now.position_deg) +
                           " and was stopped. Lower the rate or the number of samples.");
  stands_at(now.position_deg);
  if (now.moving) co_return now.position_deg;
  const double to_limit_deg =
      std::min(limits_.max_deg - now.position_deg, now.position_deg - limits_.min_deg);
  if (to_limit_deg <= rules_.tolerance_deg)
    throw MeasurementError("The turning stage came to its soft limit at " + in_deg(now.position_deg) +
                           " and stands there. Lower the rate or the number of samples.");
  throw UnsteadyTurn("the stage stopped at " + in_deg(now.position_deg) + " although it should turn on" +
                     (now.warnings.empty() ? "" : " (it says: " + now.warnings.front() + ")") +
                     ". Check that nothing blocks it, its power, and that nobody pressed its stop.");
}

awaitable<void> StageMotion::stop_turning_once() {
  co_await stage_.stop();
  const StageStatus now = co_await stage_.status();
  stands_at(now.position_deg);
  readback_deg_ = now.position_deg;
  approach_ = 0;
  settled_us_ = 0;
}

awaitable<void> StageMotion::stop_turning() {
  std::exception_ptr why;
  try {
    co_await stop_turning_once();
    co_return;
  } catch (...) {
    why = std::current_exception();
  }
  control_.stop_if_aborted();
  status_.note("warning", "stage: " + sentence(why) + " It is ordered to stop again.");
  co_await recover(1, is_stage_lost(why));
  co_await stop_turning_once();
}

}  // namespace rig
