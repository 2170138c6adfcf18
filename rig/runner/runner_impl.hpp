// SPDX-License-Identifier: MIT
#pragma once

// The inside of Runner, shared by the runner_*.cpp files only.

#include <boost/asio/post.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/this_coro.hpp>
#include <boost/asio/thread_pool.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <deque>
#include <future>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "rig/runner/failures.hpp"
#include "rig/runner/gate.hpp"
#include "rig/runner/placed_bench.hpp"
#include "rig/runner/runner.hpp"
#include "rig/runner/session_clock.hpp"
#include "rig/runner/surface_echoes.hpp"
#include "rig/runner/target_detection.hpp"
#include "rig/runner/time_left.hpp"

namespace rig {

namespace asio = boost::asio;
using asio::awaitable;
using nlohmann::json;

constexpr int failures_without_scan = 3;  // A lidar that reconnects and never measures is lost.

/// With its unit, to a ten-thousandth: finer than any stage here reads back.
std::string in_deg(double deg);
json json_of(const Value& value);
Value value_of(const json& stored);
struct Track;
struct TurningScans;
class ScanGate;

constexpr int stage_attempts = 3;  // Of a move, a homing, a turn.
struct Runner::Impl final : StepContext {
  Procedure procedure;
  fit::Bench known_bench;
  SessionStore& session;
  RunnerParts parts;
  std::vector<PlannedStep> plan;
  StageLimits limits;
  RunState state;
  std::vector<Observer> observers;

  std::map<std::string, std::string> progress;  // As in the session.
  Variables variables;
  PlacedBench placed;
  std::set<std::string> skipped_turns;
  std::size_t current = 0;
  std::string current_name;
  json outputs;  // Variables set by the running step, kept for a resumed run.
  std::optional<std::size_t> jump;

  bool aborted = false, paused = false, streaming = false, connected = false;
  bool lidar_is_simulated = false;
  Gate abort_gate, resume_gate, answer_gate;
  std::optional<Answer> answered;

  double position_deg = 0;
  double readback_deg = 0;
  int last_approach = 0;
  std::int64_t settled_us = 0;
  SessionClock time;
  std::optional<std::uint64_t> seen_ms;  // The latest stamp since the lidar was connected.
  TimeLeft time_left;
  std::int64_t step_begun_us = 0, step_paused_us = 0;
  double step_done_before = 0;  // By an earlier run, as a share.

  Impl(Procedure procedure_, fit::Bench bench_, SessionStore& session_, RunnerParts parts_);

  // What the session knows

  void check_same_procedure();

  json variables_json() const;

  void describe_session();
  /// How far the session is, in the operator's terms: captures, the next step, the variables it sees.
  std::string resumed_words() const;
  /// The captures of an unfinished step that are whole.
  long captures_begun(const PlannedStep& step) const;
  /// The plan for those who watch the session: key (as in its progress) and words of every step.
  json steps_json() const;

  json progress_of(const std::string& part) const;

  void record(const std::string& part, const json& what);

  bool recorded(const std::string& part) const override { return progress.count(part) > 0; }

  // Time

  void estimate_time_left();
  TimeLeft::Running running_step() const;

  // Observers, events

  void changed();

  void note(const std::string& level, const std::string& text) override;
  /// As note(), to those who watch only: the session is finished.
  void announce(const std::string& level, const std::string& text);

  void stop_if_aborted() const;

  // StepContext

  const fit::Bench& bench() const override { return known_bench; }
  const StageRules& rules() const override { return procedure.stage; }
  const std::string& key() const override { return plan[current].key; }
  const std::string& name() const override { return current_name; }
  double stage_deg() const override { return position_deg; }

  awaitable<void> checkpoint(long done, long total) override;

  void set(const std::string& variable, const Value& value) override;

  void skip_rest_of_iteration() override;

  awaitable<json> fit(std::string kind, json options) override;

  awaitable<void> report(std::string file) override;

  /// Where the report goes. Throws UsageError when a link leads it out of the session's folder.
  std::string report_target(const std::string& file) const;

  /// What `work` returns or throws, computed on the worker while the I/O thread goes on. Calling the wait off
  /// ends it at once; the work goes on and its result is thrown away, so `work` owns all that it uses.
  template <typename Work>
  awaitable<std::invoke_result_t<Work&>> compute(Work work);
  bool computing = false;

  void for_each_scan(std::int64_t capture,
                     const std::function<void(const fit::ScanView&)>& visit) const override;

  // Stage

  awaitable<void> home(bool again) override;
  awaitable<void> home_once(bool again);

  awaitable<StageStatus> stage_status();

  void check_soft_limits(double target_deg, const FilePosition& place) const;

  awaitable<double> move_to(double target_deg, int approach, const FilePosition& place) override;

  /// One move of the stage, tried again when the link or the stage failed in a way that it recovers from.
  awaitable<double> drive_to(double target_deg);

  awaitable<void> recover_stage(int attempt, bool link_lost);

  awaitable<void> turn(double rate_deg_s);

  awaitable<void> stop_turning();

  /// stop_turning(), after a link that was lost is opened anew.
  awaitable<void> stop_turning_for_sure();

  // Lidar

  awaitable<void> start_stream(LidarStream stream);

  /// Once; the failure is the caller's.
  awaitable<void> end_stream();

  /// A lidar that is lost meanwhile is reconnected.
  awaitable<void> stop_stream();

  /// The next scan. The stream is started when none runs, and then `gate` begins anew; a lidar that was lost
  /// is reconnected unless that happened too often (`failures`) since the caller last got what it wanted.
  awaitable<lidar::Scan> next_scan(LidarStream stream, ScanGate* gate, int& failures);

  /// Reports and stores that the lidar's clock started again before this scan, if it did.
  void report_clock_restart(const lidar::Scan& scan);
  int clock_restarts = 0;  // That were reported.
  bool power_cycle_announced = false, intensities_missed = false;

  /// Throws if the lidar is not what the bench file describes, or reports a fault and the operator has not
  /// decided to use it all the same.
  void judge_lidar(const json& identity);
  std::string lidar_accepted;  // What was said of it then.

  awaitable<void> connect_lidar();
  /// The first connection of a run: a lidar that was switched on just now is waited for.
  awaitable<void> await_lidar();

  /// Brings a lost lidar back or gives up with a DeviceError.
  awaitable<void> reconnect_lidar(std::exception_ptr why);
  /// Tries for as long as a lidar takes to start; `why` it is gone so far, if known.
  awaitable<void> connect_again(std::exception_ptr why);

  /// Whether the device's clock runs with the host's: a simulation at full speed does not.
  awaitable<void> compare_clocks();

  void show(const lidar::Scan& scan);

  // Capture

  fit::CaptureInfo info_of(const CaptureRequest& request);

  awaitable<std::int64_t> capture(CaptureRequest request) override;

  /// What was measured before an interruption is kept, marked short, until a full capture replaces it.
  void keep_short(std::int64_t id, const CaptureRequest& request, long got);

  void replace_short_one(const CaptureRequest& request);

  awaitable<void> fill(std::int64_t id, const CaptureRequest& request, long& got);

  static std::string unfit_scans(const CaptureRequest& request);

  /// Connects a lidar anew whose scans do not belong to the capture (its timer may have jumped), unless that
  /// happened too often since the caller last got what it wanted.
  awaitable<void> reconnect_for_unfit_scans(const CaptureRequest& request, int& failures);

  void store(std::int64_t id, long seq, const lidar::Scan& scan);

  void report_losses(const CaptureRequest& request, std::uint64_t lost, std::uint64_t rejected);

  awaitable<std::int64_t> capture_turning(CaptureRequest request, double from_deg,
                                          const FilePosition& place) override;

  /// Scans of a turn wait in memory until the stage's track during them is known: the angle at the start
  /// comes from a line through the positions that the stage reported meanwhile.
  awaitable<void> fill_turning(const CaptureRequest& request, TurningScans& turned);

  /// After a turn that failed: the stage stands, and what failed is reconnected, or `why` goes on to the
  /// caller if another attempt is of no use.
  awaitable<void> recover_turn(std::exception_ptr why, int attempt);

  /// The next scan, or the stage stopped after `seconds`, when it comes to its soft limit, and an error.
  awaitable<lidar::Scan> next_scan_before_limit(double seconds);
  awaitable<void> read_quietly(lidar::Scan& scan, std::exception_ptr& why);
  awaitable<void> stop_stage_after(double seconds);

  awaitable<void> track_stage(Track& track);

  std::int64_t store_turning(const CaptureRequest& request, const TurningScans& turned,
                             const std::string& mark);
  void keep_short_turning(const CaptureRequest& request, const TurningScans& turned);

  awaitable<void> wait(double seconds) override;

  // Prompts

  awaitable<Answer> ask(Prompt prompt) override;

  /// For those who watch the session: an operator is needed, for what, since when.
  void store_waiting_prompt(const Prompt& prompt);
  /// The operator's answer, from wherever it comes first: the terminal, the bench, the live page.
  awaitable<Answer> ask_once(Prompt prompt);
  std::exception_ptr operator_failed;
  int prompts_asked = 0;

  awaitable<void> ask_operator(Prompt prompt);

  /// After a confirmation: what is not as requested; empty if all is.
  awaitable<std::string> check_after(const Prompt& prompt);

  static std::string wrong_answer(const Prompt& prompt, Answer& answer);

  awaitable<void> apply(const Prompt& prompt);

  /// A simulated bench may have been restarted meanwhile: it is put as it was.
  awaitable<void> place_again();

  /// What the rig sees, and whether it is what was requested.
  struct Observation {
    explicit Observation(bool good_ = true, std::string text_ = "") : good(good_), text(std::move(text_)) {}
    bool good;
    std::string text;
    std::optional<double> to_go_mm, intensity;  ///< Of a target.
    bool in_view = true;
  };

  awaitable<Observation> observe(Expectation expected);

  /// `seen`: of every beam from `first_step` on.
  Observation judge(const Expectation& expected, int first_step, const BeamMedians& seen) const;

  // Targets

  /// Completes what a prompt waits to see: where the target that it places will stand.
  void expect(Prompt& prompt) const;
  /// Whether a beam can see it from here, and the stage's angle is known.
  bool can_see(const fit::Target& target) const;
  Observation judge_target(const Expectation& expected, const BeamMedians& seen) const;
  /// Whether the echo follows the surface. Empty if it does.
  std::string wrong_surface(const Expectation& expected, const Observation& observed);
  /// Targets that were not checked yet, with what is to be seen: those that no prompt places, those that
  /// were not in view when a prompt placed them, and all of a run that is resumed.
  std::map<std::string, Expectation> unchecked;
  void remember_unchecked();
  /// Before a capture: checks those that are in view here. A person is asked to correct what is wrong; an
  /// unattended run ends.
  awaitable<void> check_targets();
  SurfaceEchoes surfaces;
  bool referenced = false;  ///< The stage's angle means something.

  /// Implausible values of the bench file must be confirmed before anything moves.
  awaitable<void> ask_about_bench();

  static double largest_deviation_from_line(const std::vector<double>& x, const std::vector<double>& y);

  /// While a person works at the bench: shows scans, says whether they are as requested, and brings a lidar
  /// back that was lost meanwhile. Runs until it is cancelled; end_watch() then stops the stream.
  awaitable<void> watch_bench(std::optional<Expectation> until);
  awaitable<void> watch_stream(std::optional<Expectation> until);
  awaitable<void> end_watch();
  void show(const Observation& observed);
  awaitable<void> pause_for(double seconds);
  static awaitable<void> never();

  /// Goes back to the repetition before this one; its captures stay in the session under another name.
  bool repeat_previous_turn();

  // The run

  /// Both devices connected, and the stage found standing.
  awaitable<void> prepare();

  /// Takes over what a step gave that an earlier run recorded.
  void take_over(std::size_t index);
  json resume_at;  // Where the stage stood after the last recorded step, and from which side it came.

  /// Nothing was measured now.
  void leave_out(std::size_t index);

  bool in_skipped_turn(std::size_t index) const;

  /// Before the first step that a resumed run does itself: the stage goes where it stood, from the same side.
  awaitable<void> return_to_place();

  awaitable<void> run_step();
  bool homed = false, moved = false;

  awaitable<void> run_steps();

  void go_back();

  /// run_steps with its failure as a value: `||` goes on waiting when one side throws.
  awaitable<void> run_steps_quietly();
  std::exception_ptr failure;

  /// The stage is stopped before what runs is called off: that may wait for a lidar that does not answer.
  awaitable<void> stop_stage_when_aborted();

  /// Stage stopped, laser off, whatever happened. Each with the device's own deadline.
  awaitable<void> make_safe();
  std::string safe_problems;

  void store_limits();

  bool limits_met() const;

  /// What the lidar's driver counted in this run, as an event and under "lidar_statistics".
  void record_lidar_statistics();

  void conclude();

  /// Last, because a session that was removed since its last capture is saved as it then stands.
  void finish_session();
  static bool is_stopped(const std::exception_ptr& why);

  asio::thread_pool worker{1};  // Last, so that it is joined before what its work hands back to is gone.
};

template <typename Work>
awaitable<std::invoke_result_t<Work&>> Runner::Impl::compute(Work work) {
  const auto here = co_await asio::this_coro::executor;
  const auto done = std::make_shared<Gate>();
  std::packaged_task<std::invoke_result_t<Work&>()> task(std::move(work));
  auto result = task.get_future();
  asio::post(worker, [here, done, task = std::move(task)]() mutable {
    task();
    asio::post(here, [done] { done->open(); });
  });
  computing = true;
  co_await done->wait();
  if (!done->is_open()) throw boost::system::system_error(asio::error::operation_aborted);
  computing = false;
  co_return result.get();
}

}  // namespace rig
