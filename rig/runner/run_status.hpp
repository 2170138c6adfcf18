// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "rig/runner/runner.hpp"
#include "rig/runner/session_clock.hpp"
#include "rig/runner/time_left.hpp"

namespace rig {

/// What a run shows of itself: its state and messages, to whoever watches, and its events, to the session.
/// The states of steps and the time left go together; messages are the latest hundred.
class RunStatus {
 public:
  /// All but the strings are kept by reference.
  RunStatus(const std::vector<PlannedStep>& plan, SessionStore& session, const SessionClock& time,
            const RunClock& clock, const LidarSource& lidar);

  /// What observers see. What has a method here is changed by that.
  [[nodiscard]] RunState& state() { return state_; }
  [[nodiscard]] const RunState& state() const { return state_; }

  void observe(Runner::Observer observer) { observers_.push_back(std::move(observer)); }
  /// Shows the state as it is now.
  void changed();
  /// The same, with what the run is doing.
  void doing(const std::string& activity);
  void counted(long done, long total, const char* unit);
  void show(const lidar::Scan& scan);

  /// An event of the session, and a message.
  void note(const std::string& level, const std::string& text);
  /// A message alone: the session is finished.
  void announce(const std::string& level, const std::string& text);

  // Steps, by their index in the plan.

  /// `done_before`: the share of it that an earlier run had done.
  void begin_step(std::size_t step, double done_before);
  /// The step that runs is done, and recorded.
  void finish_step();
  /// Nothing is measured in this step: an earlier run had done it, or it is left out.
  void leave_out(std::size_t step);
  /// These steps are to be done again.
  void begin_again(std::size_t first, std::size_t last);
  /// So long of the step that runs nothing was done.
  void paused_for(std::int64_t us) { step_paused_us_ += us; }

 private:
  [[nodiscard]] TimeLeft::Running running_step() const;
  void estimate_time_left();

  SessionStore& session_;
  const SessionClock& time_;
  const RunClock& clock_;
  const LidarSource& lidar_;
  RunState state_;
  std::vector<Runner::Observer> observers_;
  TimeLeft time_left_;
  std::int64_t step_begun_us_ = 0, step_paused_us_ = 0;
  double step_done_before_ = 0;
};

}  // namespace rig
