// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "rig/runner/runner_impl.hpp"

namespace rig {

std::string in_deg(double deg) { return rounded_text(deg, 4) + " deg"; }

awaitable<void> Runner::Impl::home(bool again) {
  for (int attempt = 1;; ++attempt) {
    std::exception_ptr why;
    try {
      co_await home_once(again);
      co_return;
    } catch (...) {
      why = std::current_exception();
    }
    stop_if_aborted();
    if (attempt >= stage_attempts || !is_stage_error(why)) std::rethrow_exception(why);
    note("warning", "stage: " + sentence(why) + " It is homed again.");
    co_await recover_stage(attempt, is_stage_lost(why));
  }
}

awaitable<void> Runner::Impl::home_once(bool again) {
  const StageStatus status = co_await stage_status();
  if (!status.homed || again) {
    state.activity = "homing";
    changed();
    co_await parts.stage.home();
    note("info", "stage homed");
    const StageStatus after = co_await stage_status();
    position_deg = after.position_deg;
    for (const auto& warning : after.warnings) note("warning", "stage: " + warning);
  } else {
    position_deg = status.position_deg;
  }
  referenced = true;
  last_approach = 0;
  settled_us = parts.clock.host_us();
}

awaitable<StageStatus> Runner::Impl::stage_status() { co_return co_await parts.stage.status(); }

void Runner::Impl::check_soft_limits(double target_deg, const FilePosition& place) const {
  if (target_deg < limits.min_deg - 1e-9 || target_deg > limits.max_deg + 1e-9 || !std::isfinite(target_deg))
    throw ProcedureError(place, "the stage would go to " + in_deg(target_deg) + ", beyond its soft limits " +
                                    to_text(limits.min_deg) + " to " + to_text(limits.max_deg) +
                                    " deg (stage.limits_deg in the bench file). Nothing was moved.");
}

awaitable<double> Runner::Impl::move_to(double target_deg, int approach, const FilePosition& place) {
  check_soft_limits(target_deg, place);
  stop_if_aborted();
  const bool stands_there =
      target_deg == position_deg && settled_us != 0 && (approach == 0 || last_approach == approach);
  if (stands_there) co_return readback_deg;
  state.activity = "moving to " + in_deg(target_deg);
  changed();
  for (int attempt = 1;; ++attempt) {
    if (approach != 0 && (last_approach != approach || (target_deg - position_deg) * approach <= 0)) {
      const double run_up_deg =
          std::clamp(target_deg - approach * procedure.stage.margin_deg, limits.min_deg, limits.max_deg);
      co_await drive_to(run_up_deg);
    }
    readback_deg = co_await drive_to(target_deg);
    // After a recovery on the way the last move may have come from the wrong side.
    const bool right_side = approach == 0 || last_approach == approach || attempt >= stage_attempts;
    if (std::abs(readback_deg - target_deg) <= procedure.stage.tolerance_deg) {
      if (right_side) break;
      continue;
    }
    const std::string seen =
        "The stage was sent to " + in_deg(target_deg) + " and reads back " + in_deg(readback_deg);
    if (attempt >= stage_attempts)
      throw StageError(seen + ", " + std::to_string(attempt) +
                       " times. It was stopped. Check that nothing blocks it and that its scale is right "
                       "(stage in the bench file), then continue with rig resume.");
    note("warning", seen + "; the move is repeated");
    last_approach = 0;
  }
  if (procedure.stage.settle_s > 0) {
    co_await parts.clock.sleep(procedure.stage.settle_s);
  }
  settled_us = parts.clock.host_us();
  co_return readback_deg;
}

awaitable<double> Runner::Impl::drive_to(double target_deg) {
  for (int attempt = 1;; ++attempt) {
    stop_if_aborted();
    std::exception_ptr why;
    try {
      const double arrived_deg = co_await parts.stage.move_to(target_deg);
      last_approach = target_deg > position_deg ? 1 : target_deg < position_deg ? -1 : last_approach;
      position_deg = target_deg;
      co_return arrived_deg;
    } catch (...) {
      why = std::current_exception();
    }
    stop_if_aborted();
    if (attempt >= stage_attempts) std::rethrow_exception(why);
    note("warning", "stage: " + sentence(why) + " The rig tries again.");
    co_await recover_stage(attempt, is_stage_lost(why));
  }
}

awaitable<void> Runner::Impl::recover_stage(int attempt, bool link_lost) {
  co_await parts.clock.sleep(0.5 * attempt);
  last_approach = 0;
  std::exception_ptr why;
  try {
    if (link_lost) {
      co_await parts.stage.reopen();
    }
    co_await parts.stage.stop();
    const StageStatus status = co_await stage_status();
    position_deg = status.position_deg;
    if (!status.homed && !procedure.stage.unhomed) {
      note("warning", "the stage has lost its reference and is homed again");
      co_await home_once(true);
    }
  } catch (...) {
    why = std::current_exception();
  }
  stop_if_aborted();
  if (why) note("warning", "stage: " + words_of(why));
}

awaitable<void> Runner::Impl::turn(double rate_deg_s) {
  stop_if_aborted();
  state.activity = "turning at " + to_text(rate_deg_s) + " deg/s";
  changed();
  co_await parts.stage.turn(rate_deg_s);
}

awaitable<void> Runner::Impl::stop_turning() {
  co_await parts.stage.stop();
  position_deg = readback_deg = (co_await stage_status()).position_deg;
  last_approach = 0;
  settled_us = 0;
}

awaitable<void> Runner::Impl::stop_turning_for_sure() {
  std::exception_ptr why;
  try {
    co_await stop_turning();
    co_return;
  } catch (...) {
    why = std::current_exception();
  }
  stop_if_aborted();
  note("warning", "stage: " + sentence(why) + " It is ordered to stop again.");
  co_await recover_stage(1, is_stage_lost(why));
  co_await stop_turning();
}

}  // namespace rig
