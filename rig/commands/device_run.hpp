// SPDX-License-Identifier: MIT
#pragma once

#include <unistd.h>

#include <boost/asio/co_spawn.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "rig/command.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/fitting.hpp"
#include "rig/live/foxglove_server.hpp"
#include "rig/live/live_page.hpp"
#include "rig/live/live_server.hpp"
#include "rig/output_place.hpp"
#include "rig/report/report.hpp"
#include "rig/runner/bench_file.hpp"
#include "rig/runner/device_lock.hpp"
#include "rig/runner/operators.hpp"
#include "rig/runner/run_view.hpp"
#include "rig/runner/scip_source.hpp"
#include "rig/session/database_errors.hpp"
#include "rig/session/session_file.hpp"
#include "rig/stage/stage_patience.hpp"

namespace rig::commands {

namespace asio = boost::asio;
using nlohmann::json;
using std::chrono::steady_clock;

inline std::int64_t unix_ns() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
}

/// Where a run's state goes that browsers shall see; empty functions: nowhere.
struct PageOutput {
  std::function<void(const json& state)> publish;
  std::function<void(const std::string& type, const std::string& bytes)> show_picture;
};

/// Publishes the run's state to the live page and to Foxglove, where they are, at most 20 times a second.
class LiveView final : public RunView {
 public:
  /// `folder`: of the procedure, whose pictures are named from there.
  LiveView(PageOutput page, FoxgloveServer* foxglove, const fit::Bench& bench, std::filesystem::path folder)
      : page_(std::move(page)), foxglove_(foxglove), bench_(bench), folder_(std::move(folder)) {}
  void show(const RunState& state) override {
    const auto now = steady_clock::now();
    const bool turned = state.phase != phase_ || state.step != step_ || state.messages_total != messages_;
    if (!turned && now - last_ < std::chrono::milliseconds(50)) return;
    last_ = now, phase_ = state.phase, step_ = state.step, messages_ = state.messages_total;
    json document = to_json(state, bench_);
    if (foxglove_) foxglove_->publish(document, unix_ns());
    if (!page_.publish) return;
    show_picture(state.prompt ? state.prompt->picture : "");
    // The page outlives this program: it keeps what it shows at the end.
    if (state.phase == RunState::Phase::done && state.report.ends_with(".html"))
      document["end"]["html"] = bytes_of(state.report, largest_report_bytes);
    page_.publish(document);
  }

 private:
  static constexpr std::size_t largest_report_bytes = 16'000'000, largest_picture_bytes = 8'000'000;

  /// What is in a file; empty if it cannot be read or is larger.
  static std::string bytes_of(const std::filesystem::path& path, std::size_t largest) {
    std::ifstream file(path, std::ios::binary);
    std::string bytes(largest + 1, '\0');
    file.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    bytes.resize(static_cast<std::size_t>(file.gcount()));
    return bytes.size() > largest ? "" : bytes;
  }

  void show_picture(const std::string& name) {
    if (name == picture_) return;
    picture_ = name;
    static const std::map<std::string, std::string> types = {
        {".png", "image/png"}, {".jpg", "image/jpeg"}, {".jpeg", "image/jpeg"}, {".svg", "image/svg+xml"}};
    const auto type = types.find(std::filesystem::path(name).extension().string());
    if (name.empty() || type == types.end()) return page_.show_picture("", "");
    page_.show_picture(type->second, bytes_of(folder_ / name, largest_picture_bytes));
  }

  PageOutput page_;
  FoxgloveServer* foxglove_;
  const fit::Bench& bench_;
  std::filesystem::path folder_;
  std::string picture_;
  steady_clock::time_point last_{};
  RunState::Phase phase_ = RunState::Phase::starting;
  std::size_t step_ = 0;
  std::uint64_t messages_ = 0;
};

/// In a handler: whether the run was ended by what is no fault of the session's file.
inline bool is_fault_of_others() {
  try {
    throw;
  } catch (const RunStopped&) {
  } catch (const UsageError&) {
  } catch (const DeviceError&) {
  } catch (...) {
    return false;
  }
  return true;
}

/// Removes a session whose first step was not done, which would only be in the way of the next attempt.
inline bool remove_if_unbegun(std::unique_ptr<SessionStore>& session) {
  const std::string path = session->path();
  try {
    if (!session->progress().empty() || session->count_captures() > 0) return false;
  } catch (const std::exception&) {
    return false;
  }
  session.reset();
  std::error_code failed;
  return std::filesystem::remove(path, failed);
}

/// Removes a session in which no run ever did anything: its program was killed at once. Whatever else is
/// there stays.
inline void remove_empty_session(const std::string& path) {
  std::error_code failed;
  if (!std::filesystem::is_regular_file(path, failed) || !is_recording(path) || is_being_written(path))
    return;
  try {
    const SessionStore session(path, SessionStore::Mode::read);
    if (!session.progress().empty() || session.count_captures() > 0 || !session.latest_results().empty())
      return;
  } catch (const std::exception&) {
    return;  // It is refused by who is to write it, with the reason.
  }
  for (const char* ending : {"", "-wal", "-shm", "-journal"}) std::filesystem::remove(path + ending, failed);
}

/// Ctrl-C, and being asked to end, from before there is a session to after its end.
class Interruption {
 public:
  explicit Interruption(asio::io_context& io)
      : signals_(io, SIGINT, SIGTERM, SIGHUP), obey_([&io] { io.stop(); }) {
    signals_.async_wait([this](const boost::system::error_code& error, int) {
      if (error) return;
      came_ = true;
      obey_();
    });
  }
  [[nodiscard]] bool came() const { return came_; }
  void obey_by(std::function<void()> what) { obey_ = std::move(what); }
  void over() { signals_.cancel(); }

 private:
  asio::signal_set signals_;
  std::function<void()> obey_;
  bool came_ = false;
};

/// A procedure on its devices, with all that watches and answers it: what `rig run` and `rig resume` share.
class DeviceRun {
 public:
  std::string lidar, stage, operator_port;
  bool yes = false;
  bool doubts_bench = false;  ///< RunnerParts::doubts_bench

  void declare(CLI::App& command) {
    command.add_option("--lidar", lidar, "tcp://HOST[:PORT]");
    command.add_option("--stage", stage, "serial:PATH[?language=zaber&baud=...] (docs/operate/stages.md)");
    command.add_flag("--yes", yes, "Confirm every prompt: unattended run");
    command.add_flag("--accept-lidar", accept_lidar_,
                     "Measure even if model or serial number differ from the bench file, or the lidar "
                     "reports a fault; recorded in session and certificate");
    command.add_option("--operator", operator_port,
                       "HOST:PORT of a simulated bench that answers prompts itself");
    live_option_ = command.add_option("--live", live_.port, "Serve the live page; on PORT if given")
                       ->expected(0, 1)
                       ->default_str("0");
    foxglove_option_ = command.add_option("--foxglove", foxglove_.port,
                                          "Serve the run to Foxglove on PORT (0: any free one)");
    command
        .add_option("--live-listen", live_.address,
                    "Address of the live page and of --foxglove; any other than loopback needs --live-token")
        ->capture_default_str();
    command.add_option("--live-token", live_.token, "Secret that the live page's address must contain");
    command.add_flag("--json-log", json_log_, "One JSON object per line on standard output, for programs");
  }

  /// A live page that outlives each of several runs, if one is asked for; they show themselves on it.
  std::unique_ptr<LivePage> page_for_several() {
    if (live_option_->count() == 0) return nullptr;
    auto page = std::make_unique<LivePage>(live_);
    std::fprintf(stderr, "live page: %s\n", page->url().c_str());
    page_ = page.get();
    return page;
  }

  /// Whether lines for machines go to standard output.
  [[nodiscard]] bool logs_json() const { return json_log_; }

  /// To the end. `resumed`: the file holds an earlier part of the run.
  int run(const Procedure& procedure, const fit::Bench& bench, const std::string& out, bool resumed) {
    if (lidar.empty())
      throw UsageError("--lidar is missing: give tcp://HOST:PORT (`rig devices` looks for it).");
    if (stage.empty())
      throw UsageError("--stage is missing: give serial:PATH (`rig devices` lists the ports).");
    std::signal(SIGPIPE, SIG_IGN);
    const Endpoint lidar_address = parse_endpoint(lidar, "--lidar", scip_port);
    const StageOptions known_stage = bench_stage_options(bench);
    asio::io_context io(1);
    Interruption interruption(io);
    if (!resumed) remove_empty_session(out);
    auto stored = std::make_unique<SessionStore>(
        out, resumed ? SessionStore::Mode::append : SessionStore::Mode::create);
    try {
      return run_in(io, interruption, *stored, procedure, bench, lidar_address, known_stage);
    } catch (const SessionDiskError&) {
      if (resumed || !remove_if_unbegun(stored)) throw;
      throw MeasurementError("cannot write " + out +
                             ": the disk is full or fails. Nothing was captured, and nothing is left of the "
                             "file. Free some space, or choose another disk, and begin again.");
    } catch (...) {
      if (!resumed && is_fault_of_others()) remove_if_unbegun(stored);
      throw;
    }
  }

 private:
  static constexpr std::uint16_t scip_port = 10940;

  int run_in(asio::io_context& io, Interruption& interruption, SessionStore& session,
             const Procedure& procedure, const fit::Bench& bench, const Endpoint& lidar_address,
             const StageOptions& known_stage) {
    // Before the lidar is spoken to: who connects to one that is measuring stops it.
    DeviceLocks locks("session " + std::filesystem::absolute(session.path()).string());
    locks.lock("lidar", lidar_address.host + ":" + std::to_string(lidar_address.port));
    const auto source = make_scip_source(io.get_executor(), lidar_address);
    const auto clock = make_real_clock();
    const auto person = make_operator(io.get_executor());

    const auto started = steady_clock::now();
    std::unique_ptr<Stage> opened_stage;
    std::exception_ptr failure;
    auto opening = open_stage_patiently(io.get_executor(), stage, known_stage);
    asio::co_spawn(io, std::move(opening), [&](std::exception_ptr why, std::unique_ptr<Stage> opened) {
      failure = why;
      opened_stage = std::move(opened);
      io.stop();
    });
    io.run();
    if (interruption.came() || (!failure && !opened_stage))
      throw RunStopped("Stopped by the operator before anything moved.");
    if (failure) std::rethrow_exception(failure);
    io.restart();
    const auto write = [](const std::string& file, const std::string& output) {
      (void)check_output({output}, {file});
      const IssuedReport issued = issue_report(file, output);
      return RunnerParts::Written{issued.file, issued.certificates};
    };
    remember_addresses(session);
    procedure_file_ = procedure.file;
    RunnerParts parts{*source, *opened_stage, *clock,       *person, fit_function(),
                      write,   accept_lidar_, doubts_bench, &locks};
    Runner runner(procedure, bench, session, parts);
    return conduct(io, interruption, runner, bench, session, started);
  }

  /// What `rig resume` goes on with.
  void remember_addresses(SessionStore& session) const {
    session.set("devices",
                json{{"lidar", lidar}, {"stage", stage}, {"operator", operator_port}, {"yes", yes}}.dump());
  }

  std::unique_ptr<Operator> make_operator(const asio::any_io_executor& executor) const {
    if (yes && !operator_port.empty()) throw UsageError("give either --yes or --operator.");
    if (yes) return make_absent_operator();
    if (!operator_port.empty())
      return make_bench_operator(executor, parse_endpoint(operator_port, "--operator", 0));
    return make_terminal_operator(executor, live_option_->count() > 0);
  }

  static std::function<json(const std::string&, const SessionStore&, const json&)> fit_function() {
    return [](const std::string& kind, const SessionStore& session, const json& options) {
      return run_fit(kind, {{session.path(), &session}}, options);
    };
  }

  int conduct(asio::io_context& io, Interruption& interruption, Runner& runner, const fit::Bench& bench,
              SessionStore& session, steady_clock::time_point started) {
    const auto procedure_folder =
        std::filesystem::path(session.get("procedure_file").value_or(procedure_file_)).parent_path();
    std::unique_ptr<LiveServer> live;
    std::unique_ptr<FoxgloveServer> foxglove;
    std::vector<std::unique_ptr<RunView>> views;
    PageOutput page;
    if (page_) {
      page = {
          [this](const json& state) { page_->publish(state); },
          [this](const std::string& type, const std::string& bytes) { page_->show_picture(type, bytes); }};
      page_->obey(io.get_executor(), [&runner](const json& command) { runner.command(command); });
    } else if (live_option_->count() > 0) {
      live = std::make_unique<LiveServer>(io.get_executor(), live_,
                                          [&runner](const json& command) { runner.command(command); });
      std::fprintf(stderr, "live page: %s\n", live->url().c_str());
      page = {
          [&live](const json& state) { live->publish(state); },
          [&live](const std::string& type, const std::string& bytes) { live->show_picture(type, bytes); }};
    }
    // For `rig watch FOLDER`; a secret stays out of the file.
    session.set("live_page", live && live_.token.empty() ? live->url() : "");
    if (foxglove_option_->count() > 0) {
      foxglove_.address = live_.address, foxglove_.token = live_.token;
      foxglove = std::make_unique<FoxgloveServer>(io.get_executor(), foxglove_, bench.lidar.mount);
      std::fprintf(stderr, "foxglove: %s\n", foxglove->url().c_str());
    }
    if (page.publish || foxglove)
      views.push_back(std::make_unique<LiveView>(std::move(page), foxglove.get(), bench, procedure_folder));
    views.push_back(make_terminal_view(stderr, isatty(STDERR_FILENO) != 0));
    if (json_log_) views.push_back(make_json_log(stdout));
    for (const auto& view : views) runner.observe([&view](const RunState& state) { view->show(state); });

    interruption.obey_by([&runner] {
      std::signal(SIGINT, SIG_DFL);  // A second Ctrl-C ends the program at once.
      runner.abort();
    });
    std::exception_ptr failure;
    bool met = false;
    auto running = runner.run();
    asio::co_spawn(io, std::move(running), [&](std::exception_ptr why, bool limits_met) {
      failure = why;
      met = limits_met;
      interruption.over();
      const auto end = [&io] { io.stop(); };
      const auto end_foxglove = [&foxglove, end] { foxglove ? foxglove->finish(end) : end(); };
      live ? live->finish(end_foxglove) : end_foxglove();
    });
    io.run();
    if (page_) page_->obey_nobody();
    views.clear();
    const double seconds = std::chrono::duration<double>(steady_clock::now() - started).count();
    if (!failure || isatty(STDERR_FILENO) != 0) {
      std::fputs(summary_text(runner.state(), session, seconds).c_str(), stderr);
    }
    const std::string& report = runner.state().report;
    if (!report.empty()) std::fprintf(stderr, "report: %s\n", report.c_str());
    if (failure) std::rethrow_exception(failure);
    if (!met)
      throw MeasurementError("not every limit is met; the list above and the report say which and why.");
    return 0;
  }

  bool json_log_ = false;
  LivePage* page_ = nullptr;
  std::string procedure_file_;
  LiveServer::Options live_;
  bool accept_lidar_ = false;
  WebAccess foxglove_;
  CLI::Option *live_option_ = nullptr, *foxglove_option_ = nullptr;
};

}  // namespace rig::commands
