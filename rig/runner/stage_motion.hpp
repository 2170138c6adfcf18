// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/awaitable.hpp>
#include <cstdint>
#include <string>

#include "rig/errors.hpp"
#include "rig/procedure/step.hpp"
#include "rig/runner/run_control.hpp"
#include "rig/runner/run_status.hpp"
#include "rig/stage/stage.hpp"

namespace rig {

constexpr int stage_attempts = 3;  // Of a move, a homing, a turn.

/// The stage did not turn as it was told to: scans taken meanwhile have no known angles.
class UnsteadyTurn : public StageError {
  using StageError::StageError;
};

/// With its unit, to a ten-thousandth: finer than any stage here reads back.
[[nodiscard]] std::string in_deg(double deg);

/// The stage as a run moves it: where it stands, from which side it came there, and since when. What fails is
/// tried again where the stage recovers from it. Nothing moves beyond the soft limits, nor once the run is
/// stopped.
class StageMotion {
 public:
  StageMotion(Stage& stage, RunClock& clock, const StageRules& rules, const StageLimits& limits,
              RunStatus& status, const RunControl& control)
      : stage_(stage), clock_(clock), rules_(rules), limits_(limits), status_(status), control_(control) {}

  [[nodiscard]] double deg() const { return position_deg_; }
  /// Its angle means something.
  [[nodiscard]] bool referenced() const { return referenced_; }
  /// +1 or -1: the sign of the last move; 0 if nobody knows.
  [[nodiscard]] int approach() const { return approach_; }
  /// Host time since which it stands; 0 if it never settled.
  [[nodiscard]] std::int64_t settled_us() const { return settled_us_; }
  [[nodiscard]] const StageLimits& limits() const { return limits_; }
  /// Degrees to the soft limit that it turns towards; infinity if it has none.
  [[nodiscard]] double room_deg(double rate_deg_s) const;
  /// Puts its angles into a capture's circumstances.
  void describe(fit::CaptureInfo& capture) const;

  /// Takes over where it is. One that moves is stopped.
  boost::asio::awaitable<void> find();
  boost::asio::awaitable<void> home(bool again);
  /// As StepContext::move_to.
  boost::asio::awaitable<double> move_to(double target_deg, int approach, const FilePosition& written_at);
  boost::asio::awaitable<void> turn(double rate_deg_s);
  /// While it turns: where it is. Throws MeasurementError beyond the soft limits or when it stands at one,
  /// and UnsteadyTurn when it stands elsewhere.
  boost::asio::awaitable<double> turned_to();
  /// A link that was lost is opened anew.
  boost::asio::awaitable<void> stop_turning();
  /// After a failure: the link, its standstill and its reference are restored, as far as that succeeds. A
  /// lost link is waited for; throws StageError when it does not come back.
  boost::asio::awaitable<void> recover(int attempt, bool link_lost);

 private:
  boost::asio::awaitable<void> reopen();
  void check_soft_limits(double target_deg, const FilePosition& written_at) const;
  boost::asio::awaitable<void> home_once(bool again);
  boost::asio::awaitable<void> stop_turning_once();
  /// One move, tried again when the link or the stage failed in a way that it recovers from.
  boost::asio::awaitable<double> drive_to(double target_deg);
  void stands_at(double deg);

  Stage& stage_;
  RunClock& clock_;
  const StageRules& rules_;
  StageLimits limits_;
  RunStatus& status_;
  const RunControl& control_;
  double position_deg_ = 0, readback_deg_ = 0;
  int approach_ = 0;
  std::int64_t settled_us_ = 0;
  bool referenced_ = false;
};

}  // namespace rig
