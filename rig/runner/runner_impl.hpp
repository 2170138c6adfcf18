// SPDX-License-Identifier: MIT
#pragma once

// The inside of Runner, shared by the runner*.cpp files only: what steps may ask of a run, and the run
// itself. What has a state and rules of its own is a part with its own header.

#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "rig/runner/answer_desk.hpp"
#include "rig/runner/bench_observer.hpp"
#include "rig/runner/bench_watch.hpp"
#include "rig/runner/failures.hpp"
#include "rig/runner/lidar_link.hpp"
#include "rig/runner/placed_bench.hpp"
#include "rig/runner/run_control.hpp"
#include "rig/runner/run_progress.hpp"
#include "rig/runner/run_status.hpp"
#include "rig/runner/runner.hpp"
#include "rig/runner/session_clock.hpp"
#include "rig/runner/stage_motion.hpp"
#include "rig/runner/worker.hpp"

namespace rig {

namespace asio = boost::asio;
using asio::awaitable;
using nlohmann::json;

json json_of(const Value& value);
Value value_of(const json& stored);
struct TurningScans;
class TurnTrack;

struct Runner::Impl final : StepContext {
  Procedure procedure;
  fit::Bench known_bench;
  SessionStore& session;
  RunnerParts parts;
  std::vector<PlannedStep> plan;
  Variables variables;
  PlacedBench placed;
  std::vector<std::string> warned_of_moved;  ///< Targets of the last warning.

  SessionClock time;
  RunControl control;
  RunStatus status;
  RunProgress progress;
  StageMotion stage;
  LidarLink lidar_link;
  BenchObserver observer;
  AnswerDesk desk;
  BenchWatch watch;

  Impl(Procedure procedure_, fit::Bench bench_, SessionStore& session_, RunnerParts parts_);

  void note(const std::string& level, const std::string& text) override { status.note(level, text); }
  RunState& state() { return status.state(); }
  const RunState& state() const { return status.state(); }

  // What the session says of the run (runner_session.cpp)

  void check_same_procedure();
  json variables_json() const;
  void describe_session();
  /// How far the session is, in the operator's terms: captures, the next step, the variables it sees.
  std::string resumed_words() const;
  /// The plan for those who watch the session: key (as in its progress) and words of every step.
  json steps_json() const;
  void store_limits();
  bool limits_met() const;
  /// Last, because a session that was removed since its last capture is saved as it then stands.
  void finish_session();

  // The run (runner.cpp)

  std::size_t current = 0;
  std::string current_name;
  json outputs;  // Variables set by the running step, kept for a resumed run.
  std::set<std::string> skipped_turns;
  std::optional<std::size_t> jump;  // To the step with which a turn is repeated.
  json resume_at;  // Where the stage stood after the last recorded step, and from which side it came.
  bool homed = false, moved = false;
  std::exception_ptr failure;
  std::string made_safe, safe_problems;  // What the end of the run gave, in words.

  /// Both devices connected, and the stage found standing.
  awaitable<void> prepare();
  /// As for the lidar. Throws DeviceError when the session was begun with another one.
  void demand_same_stage(const StageIdentity& found) const;
  /// Takes over what a step gave that an earlier run recorded.
  void take_over(std::size_t index);
  bool in_skipped_turn(std::size_t index) const;
  /// Before the first step that a resumed run does itself: the stage goes where it stood, from the same side.
  awaitable<void> return_to_place();
  awaitable<void> run_step();
  awaitable<void> run_steps();
  void go_back();
  /// run_steps with its failure as a value: `||` goes on waiting when one side throws.
  awaitable<void> run_steps_quietly();
  /// The stage is stopped before what runs is called off: that may wait for a lidar that does not answer.
  awaitable<void> stop_stage_when_aborted();
  /// Stage stopped, laser off, whatever happened. Each with the device's own deadline.
  awaitable<void> make_safe();
  void conclude();

  // What a step knows and may ask for (runner_steps.cpp)

  const fit::Bench& bench() const override { return known_bench; }
  const StageRules& rules() const override { return procedure.stage; }
  const std::string& key() const override { return plan[current].key; }
  const std::string& name() const override { return current_name; }
  double stage_deg() const override { return stage.deg(); }
  bool recorded(const std::string& part) const override { return progress.has(part); }
  awaitable<void> checkpoint(long done, long total) override;
  void set(const std::string& variable, const Value& value) override;
  void skip_rest_of_iteration() override;
  awaitable<json> fit(std::string kind, json options) override;
  awaitable<void> report(std::string file) override;
  /// Where the report goes. Throws UsageError when a link leads it out of the session's folder.
  std::string report_target(const std::string& file) const;
  void for_each_scan(std::int64_t capture,
                     const std::function<void(const fit::ScanView&)>& visit) const override;
  awaitable<void> home(bool again) override;
  awaitable<double> move_to(double target_deg, int approach, const FilePosition& written_at) override;
  awaitable<void> wait(double seconds) override;

  // Captures (runner_capture.cpp)

  fit::CaptureInfo info_of(const CaptureRequest& request);
  void warn_of_moved(const std::vector<std::string>& targets);
  awaitable<std::int64_t> capture(CaptureRequest request) override;
  /// What was measured before an interruption is kept, marked short, until a full capture replaces it.
  void keep_short(std::int64_t id, const CaptureRequest& request, long got);
  void replace_short_one(const CaptureRequest& request);
  awaitable<void> fill(std::int64_t id, const CaptureRequest& request, long& got);
  void store(std::int64_t id, long seq, const lidar::Scan& scan);
  /// Once a run. `scan_mm`: what all scans of a capture are.
  void warn_of_frozen_scans(const CaptureRequest& request, const std::vector<std::uint16_t>& scan_mm);
  bool warned_of_frozen = false;
  void report_losses(const CaptureRequest& request, std::uint64_t lost, std::uint64_t rejected);

  // Captures while the stage turns (runner_turning.cpp)

  awaitable<std::int64_t> capture_turning(CaptureRequest request, double from_deg,
                                          const FilePosition& written_at) override;
  /// Scans of a turn wait in memory until the stage's track during them is known: the angle at the start
  /// comes from a line through the positions that the stage reported meanwhile.
  awaitable<void> fill_turning(const CaptureRequest& request, TurningScans& turned);
  /// After a turn that failed: the stage stands, and what failed is reconnected, or `why` goes on to the
  /// caller if another attempt is of no use.
  awaitable<void> recover_turn(std::exception_ptr why, int attempt);
  /// The next scan, or the stage stopped after `seconds`, when it comes to its soft limit, and an error.
  /// Infinity: it has no limit to come to.
  awaitable<lidar::Scan> next_scan_before_limit(double seconds);
  awaitable<void> read_quietly(lidar::Scan& scan, std::exception_ptr& why);
  awaitable<void> track_stage(TurnTrack& track);
  std::int64_t store_turning(const CaptureRequest& request, const TurningScans& turned,
                             const std::string& mark);
  void keep_short_turning(const CaptureRequest& request, const TurningScans& turned);

  // Prompts (runner_prompts.cpp)

  int prompts_asked = 0;

  awaitable<Answer> ask(Prompt prompt) override;
  /// For those who watch the session: an operator is needed, for what, since when.
  void store_waiting_prompt(const Prompt& prompt);
  awaitable<Answer> ask_once(Prompt prompt);
  /// After a confirmation: what is not as requested; empty if all is.
  awaitable<std::string> check_after(const Prompt& prompt);
  awaitable<void> apply(const Prompt& prompt);
  /// A simulated bench may have been restarted meanwhile: it is put as it was.
  awaitable<void> place_again();
  /// Before a capture: checks targets that were not checked yet and are in view here. A person is asked to
  /// correct what is wrong; an unattended run ends.
  awaitable<void> check_targets();
  /// Implausible values of the bench file must be confirmed before anything moves.
  awaitable<void> ask_about_bench();
  /// Goes back to the repetition before this one; its captures stay in the session under another name.
  bool repeat_previous_turn();

  Worker worker;  // Last, so that it is waited for before what its work hands back to is gone.
};

}  // namespace rig
