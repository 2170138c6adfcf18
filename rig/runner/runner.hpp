// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <boost/asio/awaitable.hpp>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "rig/procedure/procedure_plan.hpp"
#include "rig/runner/lidar_source.hpp"
#include "rig/session/session_store.hpp"
#include "rig/stage/stage.hpp"

namespace rig {

/// The runner's time. Tests bring a clock that moves only when slept on.
class RunClock {
 public:
  virtual ~RunClock() = default;
  [[nodiscard]] virtual std::int64_t host_us() const = 0;  ///< Monotonic; the base of lidar::Scan::host_us.
  [[nodiscard]] virtual std::int64_t unix_us() const = 0;
  virtual boost::asio::awaitable<void> sleep(double seconds) = 0;
};

/// Whoever answers prompts: a person at a terminal, a simulated bench, or nobody (--yes).
class Operator {
 public:
  virtual ~Operator() = default;
  /// Answers one prompt; cancelled when the answer came from elsewhere (the live page).
  virtual boost::asio::awaitable<Answer> ask(Prompt prompt) = 0;
  /// Nobody can correct a wrong placement: the run fails instead of asking for ever.
  [[nodiscard]] virtual bool unattended() const = 0;
};

class DeviceLocks;

struct RunnerParts {
  LidarSource& lidar;
  Stage& stage;
  RunClock& clock;
  Operator& operator_;
  /// Computes a calibration of the session. Called on a thread of its own, with a session opened for reading.
  std::function<nlohmann::json(const std::string& kind, const SessionStore& session,
                               const nlohmann::json& options)>
      fit;
  /// What a report was written to, and the session's key `certificates` that remembers it (empty: none).
  struct Written {
    std::string file, certificates;
  };
  /// Writes the certificate of the session to a file in the session's folder, or beside it where another
  /// certificate has that name; on a thread of its own too.
  std::function<Written(const std::string& session_file, const std::string& file)> report;
  /// The operator decided to measure with a lidar of another model or serial number than the bench file says,
  /// or with one that says it is not well.
  bool accepts_lidar = false;
  /// Whether the bench file is right is what the run is to find out: a target that is not seen where the file
  /// says is a warning, and at a prompt a second confirmation is enough.
  bool doubts_bench = false;
  /// Keeps other runs of this computer from the same devices; null: nobody else is there.
  DeviceLocks* locks = nullptr;
};

/// Everything an observer needs to draw the run; a late observer sees all of it.
struct RunState {
  enum class Phase { starting, running, prompt, paused, done, failed, aborted };
  enum class StepState { not_started, running, recorded };
  struct Message {
    std::int64_t time_us;
    std::string level, text;
  };
  Phase phase = Phase::starting;
  std::string procedure, session;
  std::vector<std::pair<std::string, StepState>> steps;
  std::vector<std::string>
      step_keys;                   ///< Their numbers as in the file, with the turns of loops: "4.1[d=300]".
  std::size_t step = 0;            ///< Index into steps.
  std::string activity;            ///< "capture", "moving to 12.34 deg" ...
  long done = 0, total = 0;        ///< Of the current activity.
  std::string unit;                ///< Of done and total.
  double left_s = 0, overall = 0;  ///< Time left and share done of the whole run.
  std::optional<Prompt> prompt;
  lidar::Scan scan;  ///< The latest.
  bool scan_seen = false;
  double stage_deg = 0;
  bool pausing = false;  ///< A pause is asked for and takes hold when what is under way is done.
  std::uint64_t scans_lost = 0, scans_rejected = 0;
  int reconnects = 0;
  std::vector<Message> messages;  ///< The latest hundred.
  std::uint64_t messages_total = 0;
  std::vector<std::uint16_t> beam_mm;  ///< What the middle beam of the latest scans saw, oldest first.
  int beam_step = 0;
  std::string ended;   ///< Why the run ended, and how to go on; empty while it runs, and if all went well.
  std::string report;  ///< The newest report's file.
  std::string session_path;        ///< With its folder, for `rig resume`.
  std::string checks_text = "[]";  ///< The limits checked so far, JSON as in docs/operate/certificate.md.
};

/// "running", "prompt" ...
const char* phase_word(RunState::Phase phase);

/// What a prompt asks to be placed, for a program that does it: the words of the simulated bench's operator
/// port (docs/develop/simulator.md).
nlohmann::json to_json(const Placement& place);
/// A prompt as the live page and `--json-log` have it (docs/reference/live.md).
nlohmann::json to_json(const Prompt& prompt);
/// The state as the live page's document (docs/reference/live.md).
nlohmann::json to_json(const RunState& state, const fit::Bench& bench);

/// Runs one procedure: owns progress, pause, abort, checkpoints and events. It knows no terminal and no web
/// page; those observe it and send it commands. All on one thread, but for fits and reports: they are
/// computed on a second one while this one goes on serving devices, operator and page.
///
/// Whatever ends the run, the stage is stopped, the lidar's laser is switched off if it answers, and
/// everything captured is in the session. What was recorded is never measured again by a resumed run.
class Runner {
 public:
  /// Plans the run; throws ProcedureError when the bench forbids it. `session` may hold an earlier part of
  /// the run.
  Runner(Procedure procedure, fit::Bench bench, SessionStore& session, RunnerParts parts);
  /// Waits for a fit or report that an abort has left alone; to be destroyed before the io_context of run().
  ~Runner();
  Runner(const Runner&) = delete;
  Runner& operator=(const Runner&) = delete;

  /// Runs to the end. Returns true if every limit is met (or there are none). Throws DeviceError when a
  /// device was lost for good, RunStopped when the operator stopped it, else why it failed.
  boost::asio::awaitable<bool> run();

  void pause();  ///< At the next checkpoint.
  void resume();
  void abort();  ///< Now: a move is stopped, a capture under way is kept and marked short.
  void answer(const Answer& answer);
  /// A command of the live page (docs/reference/live.md); unknown ones are ignored.
  void command(const nlohmann::json& command);

  using Observer = std::function<void(const RunState&)>;
  void observe(Observer observer);
  [[nodiscard]] const RunState& state() const;
  [[nodiscard]] const std::vector<PlannedStep>& plan() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The operator stopped the run; what() says how to go on.
class RunStopped : public MeasurementError {
  using MeasurementError::MeasurementError;
};

/// Checks limits against the newest results: `limits/1` of docs/operate/certificate.md.
nlohmann::json check_limits(const std::vector<Limit>& limits, const SessionStore& session);
/// Whether every one of the checks of such a document is met for sure.
bool all_pass(const nlohmann::json& checks);

}  // namespace rig
