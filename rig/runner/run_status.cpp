// SPDX-License-Identifier: MIT
#include "rig/runner/run_status.hpp"

#include <filesystem>

#include "fit/numeric/utf8.hpp"

namespace rig {
namespace {

constexpr std::size_t messages_kept = 100, beam_ranges_kept = 400;

}  // namespace

RunStatus::RunStatus(const std::vector<PlannedStep>& plan, SessionStore& session, const SessionClock& time,
                     const RunClock& clock, const LidarSource& lidar)
    : session_(session), time_(time), clock_(clock), lidar_(lidar), time_left_(plan) {
  state_.session = std::filesystem::path(session.path()).filename().string();
  state_.session_path = session.path();
  for (const auto& step : plan) {
    state_.steps.emplace_back(step.says, RunState::StepState::not_started);
    state_.step_keys.push_back(step.key);
  }
  if (!plan.empty()) state_.left_s = time_left_.left_s(TimeLeft::Running());
}

void RunStatus::changed() {
  estimate_time_left();
  state_.scans_lost = lidar_.lost();
  state_.scans_rejected = lidar_.rejected();
  for (const auto& observer : observers_) observer(state_);
}

void RunStatus::doing(const std::string& activity) {
  state_.activity = activity;
  changed();
}

void RunStatus::counted(long done, long total, const char* unit) {
  state_.done = done;
  state_.total = total;
  state_.unit = unit;
}

void RunStatus::show(const lidar::Scan& scan) {
  auto& ranges = state_.beam_mm;
  const int middle = (scan.first_step + scan.last_step) / 2;
  if (middle != state_.beam_step || ranges.size() >= 2 * beam_ranges_kept) {
    if (middle == state_.beam_step)
      ranges.erase(ranges.begin(), ranges.end() - beam_ranges_kept);
    else
      ranges.clear();
    state_.beam_step = middle;
  }
  if (!scan.range_mm.empty()) ranges.push_back(scan.range_mm[scan.range_mm.size() / 2]);
  state_.scan = scan;
  state_.scan_seen = true;
}

void RunStatus::note(const std::string& level, const std::string& text) {
  session_.add_event(time_.now_us(), level, text);
  announce(level, text);
}

void RunStatus::announce(const std::string& level, const std::string& text) {
  // Messages quote what devices say, and become JSON.
  state_.messages.push_back({time_.now_us(), level, fit::as_utf8(text)});
  ++state_.messages_total;
  if (state_.messages.size() > messages_kept) state_.messages.erase(state_.messages.begin());
  changed();
}

void RunStatus::begin_step(std::size_t step, double done_before) {
  state_.step = step;
  state_.steps[step].second = RunState::StepState::running;
  step_begun_us_ = clock_.host_us();
  step_paused_us_ = 0;
  step_done_before_ = done_before;
  state_.activity = state_.steps[step].first;
}

void RunStatus::finish_step() {
  state_.steps[state_.step].second = RunState::StepState::recorded;
  time_left_.over(running_step());
}

void RunStatus::leave_out(std::size_t step) {
  state_.steps[step].second = RunState::StepState::recorded;
  time_left_.over(step);
}

void RunStatus::begin_again(std::size_t first, std::size_t last) {
  for (std::size_t i = first; i <= last; ++i) {
    if (state_.steps[i].second == RunState::StepState::recorded) time_left_.again(i);
    state_.steps[i].second = RunState::StepState::not_started;
  }
}

TimeLeft::Running RunStatus::running_step() const {
  TimeLeft::Running now;
  now.step = state_.step;
  now.from = step_done_before_;
  now.done = state_.total > 0 ? static_cast<double>(state_.done) / static_cast<double>(state_.total) : 0;
  now.passed_s = static_cast<double>(clock_.host_us() - step_begun_us_ - step_paused_us_) / 1e6;
  return now;
}

void RunStatus::estimate_time_left() {
  // Between steps the last one is over already.
  if (state_.step >= state_.steps.size()) return;
  if (state_.steps[state_.step].second != RunState::StepState::running) return;
  const TimeLeft::Running now = running_step();
  state_.overall = time_left_.share(now);
  state_.left_s = time_left_.left_s(now);
}

}  // namespace rig
