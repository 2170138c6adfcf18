// SPDX-License-Identifier: MIT
#include <unistd.h>

#include <boost/asio/co_spawn.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "rig/command.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/fitting.hpp"
#include "rig/live/foxglove_server.hpp"
#include "rig/live/live_server.hpp"
#include "rig/output_place.hpp"
#include "rig/report/report.hpp"
#include "rig/runner/bench_file.hpp"
#include "rig/runner/operators.hpp"
#include "rig/runner/run_view.hpp"
#include "rig/runner/scip_source.hpp"
#include "rig/stage/stage_patience.hpp"

namespace rig::commands {
namespace {

namespace asio = boost::asio;
using nlohmann::json;
using std::chrono::steady_clock;

constexpr std::uint16_t scip_port = 10940;

void check_fit_at(const Place& place, const std::string& kind, const json& options) {
  try {
    check_fit(kind, options);
  } catch (const UsageError& error) {
    throw ProcedureError(place, error.what());
  }
}

/// A value as it stands in the file; null where only the run will know it.
json value_before_run(const Node& node, const Variables& variables) {
  if (node.kind != Node::Kind::scalar) return json::array();  // No option takes a list or a map.
  try {
    const Value value = evaluate_text(node.scalar, variables);
    if (const auto* number = std::get_if<double>(&value)) return *number;
    if (const auto* flag = std::get_if<bool>(&value)) return *flag;
    if (const auto* text = std::get_if<std::string>(&value)) return *text;
  } catch (const ExpressionError&) {  // It uses what a step defines.
  }
  return nullptr;
}

/// A calibration that does not exist, and an option that it would refuse, are found before the hours of its
/// captures.
void check_fits(const std::vector<Step>& steps, const Variables& variables) {
  for (const Step& step : steps) {
    check_fits(step.steps, variables);
    const Node* kind = step.kind->name() == "fit" ? step.options.find("kind") : nullptr;
    if (!kind || has_expression(kind->scalar)) continue;
    check_fit_at(kind->place, kind->scalar, nullptr);
    const Node* options = step.options.find("options");
    if (!options) continue;
    for (const auto& [name, value] : options->members)
      check_fit_at(value.place, kind->scalar, {{name.scalar, value_before_run(value, variables)}});
  }
}

/// Publishes the run's state to the live page and to Foxglove, at most 20 times a second.
class LiveView final : public RunView {
 public:
  using Publish = std::function<void(const json& state)>;
  LiveView(std::vector<Publish> to, const fit::Bench& bench) : to_(std::move(to)), bench_(bench) {}
  void show(const RunState& state) override {
    const auto now = steady_clock::now();
    const bool turned = state.phase != phase_ || state.step != step_ || state.messages_total != messages_;
    if (!turned && now - last_ < std::chrono::milliseconds(50)) return;
    last_ = now, phase_ = state.phase, step_ = state.step, messages_ = state.messages_total;
    const json document = to_json(state, bench_);
    for (const Publish& publish : to_) publish(document);
  }

 private:
  std::vector<Publish> to_;
  const fit::Bench& bench_;
  steady_clock::time_point last_{};
  RunState::Phase phase_ = RunState::Phase::starting;
  std::size_t step_ = 0;
  std::uint64_t messages_ = 0;
};

std::int64_t unix_ns() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
}

/// In a handler: whether the run ended before its first step was done, by what is no fault of the session's
/// file.
bool is_unbegun(const SessionStore& session) {
  try {
    throw;
  } catch (const RunStopped&) {
  } catch (const UsageError&) {
  } catch (const DeviceError&) {
  } catch (...) {
    return false;
  }
  try {
    return session.progress().empty();
  } catch (const std::exception&) {
    return false;
  }
}

class Run : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* run = root.add_subcommand("run", "Runs a procedure on a lidar and a stage");
    run->add_option("procedure", procedure_, "Procedure file, or the name of a ready one")->required();
    run->add_option("--lidar", lidar_, "tcp://HOST[:PORT]");
    run->add_option("--stage", stage_, "serial:PATH[?language=zaber&baud=...] (docs/stages.md)");
    run->add_option("--bench", bench_, "Bench file; a resumed run takes it from its session");
    run->add_option("--out", out_, "Session file to write; default: the procedure's name with .rig");
    run->add_flag("--resume", resume_, "Go on with the session file where it was interrupted");
    run->add_option("--set", settings_, "NAME=VALUE: replaces a variable of the procedure");
    run->add_flag("--dry-run", dry_run_, "Print steps, travel, time and limits; touch no device");
    run->add_flag("--yes", yes_, "Confirm every prompt: nobody is there");
    run->add_flag("--accept-lidar", accept_lidar_,
                  "Measure although the lidar is of another model or serial number than the bench file says, "
                  "or says that it is not well; recorded in session and certificate");
    run->add_option("--operator", operator_, "HOST:PORT of a simulated bench that answers prompts itself");
    live_option_ = run->add_option("--live", live_.port, "Serve the live page; on PORT if given")
                       ->expected(0, 1)
                       ->default_str("0");
    foxglove_option_ =
        run->add_option("--foxglove", foxglove_.port, "Serve the run to Foxglove on PORT (0: any free one)");
    run->add_option("--live-listen", live_.address,
                    "Address of the live page and of --foxglove; others than loopback need "
                    "--live-token")
        ->capture_default_str();
    run->add_option("--live-token", live_.token, "Secret that the live page's address must carry");
    run->add_flag("--json-log", json_log_, "One JSON object a line on standard output, for machines");
    run->footer(
        "Ctrl-C stops the stage, switches the lidar's laser off and keeps all data; --resume goes on.");
    return run;
  }

  int run() override {
    const Procedure procedure = read_procedure(find_procedure(procedure_), overrides());
    check_fits(procedure.steps, procedure.variables);
    if (out_.empty()) out_ = procedure.name + ".rig";
    demand_place_to_write();
    const fit::Bench bench = known_bench();
    const auto plan =
        unroll(procedure, bench);  // What the bench forbids is found before anything is touched.
    if (dry_run_) {
      std::fputs(dry_run_text(procedure, bench, plan).c_str(), stdout);
      return 0;
    }
    if (lidar_.empty())
      throw UsageError("--lidar is missing: give tcp://HOST:PORT (`rig devices` looks for it).");
    if (stage_.empty())
      throw UsageError("--stage is missing: give serial:PATH (`rig devices` lists the ports).");
    return run_on_devices(procedure, bench);
  }

 private:
  Variables overrides() const {
    Variables values;
    for (const std::string& setting : settings_) {
      const auto equals = setting.find('=');
      if (equals == std::string::npos || equals == 0)
        throw UsageError("--set " + setting +
                         ": it takes NAME=VALUE, the name of one of the procedure's variables and what it is "
                         "to be, as in --set samples=100.");
      const std::string name = setting.substr(0, equals);
      const Value value = value_of_text(setting.substr(equals + 1));
      if (!values.emplace(name, value).second)
        throw UsageError("--set " + name + " is given twice, last as " + to_text(value) + ". Leave one out.");
    }
    return values;
  }

  /// Found before the devices are touched. A file that is there is resumed, or refused by the session itself.
  void demand_place_to_write() const {
    std::error_code missing;
    const auto type = std::filesystem::status(out_, missing).type();
    if (type == std::filesystem::file_type::regular) return;
    (void)check_output({out_, "session.rig"});
  }

  bool continues() const {
    std::error_code missing;
    const auto size = std::filesystem::file_size(out_, missing);
    return resume_ && !missing && size > 0;
  }

  fit::Bench known_bench() const {
    std::optional<std::string> stored;
    if (continues()) stored = SessionStore(out_, SessionStore::Mode::read).get("bench");
    if (bench_.empty() && !stored) throw UsageError(bench_missing());
    if (bench_.empty()) return read_bench_text(*stored, out_ + " (its bench)");
    fit::Bench bench = read_bench_file(bench_);
    if (stored && json::parse(*stored) != json::parse(fit::to_json_text(bench)))
      throw UsageError(
          bench_ + " differs from the bench that " + out_ +
          " was begun with, so it cannot be resumed. Leave --bench out, or begin a new session.");
    return bench;
  }

  std::string bench_missing() const {
    if (continues())
      return out_ +
             " holds no bench: it was ended before its run began. Give --bench FILE, the bench it runs on.";
    if (resume_)
      return "there is no session " + out_ +
             " to resume, and so no bench in it. Give the session's name with --out, or --bench FILE to "
             "begin "
             "one.";
    return "--bench is missing: the bench file says what stands where. `rig new bench FILE` writes a "
           "commented "
           "one.";
  }

  int run_on_devices(const Procedure& procedure, const fit::Bench& bench) {
    std::signal(SIGXFSZ, SIG_IGN);  // A file that may not grow is a full disk, told in words.
    std::signal(SIGPIPE, SIG_IGN);
    const Endpoint lidar_address = parse_endpoint(lidar_, "--lidar", scip_port);
    const StageOptions known_stage = bench_stage_options(bench);
    const bool resumed = continues();
    auto stored = std::make_unique<SessionStore>(
        out_, resumed ? SessionStore::Mode::append : SessionStore::Mode::create);
    try {
      return run_in(*stored, procedure, bench, lidar_address, known_stage);
    } catch (...) {
      if (!resumed && is_unbegun(*stored)) {
        stored.reset();  // It would only be in the way of the next attempt.
        std::error_code ignored;
        std::filesystem::remove(out_, ignored);
      }
      throw;
    }
  }

  int run_in(SessionStore& session, const Procedure& procedure, const fit::Bench& bench,
             const Endpoint& lidar_address, const StageOptions& known_stage) {
    asio::io_context io(1);
    const auto lidar = make_scip_source(io.get_executor(), lidar_address);
    const auto clock = make_real_clock();
    const auto person = make_operator(io.get_executor());

    const auto started = steady_clock::now();
    std::unique_ptr<Stage> stage;
    std::exception_ptr failure;
    bool stopped = false;
    {
      // Only to open the stage: the runner owns Ctrl-C afterwards.
      asio::signal_set signals(io, SIGINT, SIGTERM, SIGHUP);
      signals.async_wait([&](const boost::system::error_code& error, int) {
        if (!error) stopped = true, io.stop();
      });
      auto opening = open_stage_patiently(io.get_executor(), stage_, known_stage);
      asio::co_spawn(io, std::move(opening), [&](std::exception_ptr why, std::unique_ptr<Stage> opened) {
        failure = why;
        stage = std::move(opened);
        io.stop();
      });
      io.run();
    }
    if (stopped || (!failure && !stage)) throw RunStopped("Stopped by the operator before anything moved.");
    if (failure) std::rethrow_exception(failure);
    io.restart();
    const auto write = [](const std::string& file, const std::string& output) {
      (void)check_output({output}, {file});
      const IssuedReport issued = issue_report(file, output);
      return RunnerParts::Written{issued.file, issued.certificates};
    };
    RunnerParts parts{*lidar, *stage, *clock, *person, fit_function(), write, accept_lidar_};
    Runner runner(procedure, bench, session, parts);
    return conduct(io, runner, bench, session, started);
  }

  std::unique_ptr<Operator> make_operator(const asio::any_io_executor& executor) const {
    if (yes_ && !operator_.empty()) throw UsageError("give one of --yes and --operator.");
    if (yes_) return make_absent_operator();
    if (!operator_.empty()) return make_bench_operator(executor, parse_endpoint(operator_, "--operator", 0));
    return make_terminal_operator(executor, live_option_->count() > 0);
  }

  static std::function<json(const std::string&, const SessionStore&, const json&)> fit_function() {
    return [](const std::string& kind, const SessionStore& session, const json& options) {
      return run_fit(kind, {{session.path(), &session}}, options);
    };
  }

  int conduct(asio::io_context& io, Runner& runner, const fit::Bench& bench, SessionStore& session,
              steady_clock::time_point started) {
    std::unique_ptr<LiveServer> live;
    std::unique_ptr<FoxgloveServer> foxglove;
    std::vector<LiveView::Publish> publish;
    std::vector<std::unique_ptr<RunView>> views;
    if (live_option_->count() > 0) {
      live = std::make_unique<LiveServer>(io.get_executor(), live_,
                                          [&runner](const json& command) { runner.command(command); });
      std::fprintf(stderr, "live page: %s\n", live->url().c_str());
      publish.push_back([&live](const json& state) { live->publish(state); });
    }
    if (foxglove_option_->count() > 0) {
      foxglove_.address = live_.address, foxglove_.token = live_.token;
      foxglove = std::make_unique<FoxgloveServer>(io.get_executor(), foxglove_, bench.lidar.mount);
      std::fprintf(stderr, "foxglove: %s\n", foxglove->url().c_str());
      publish.push_back([&foxglove](const json& state) { foxglove->publish(state, unix_ns()); });
    }
    if (!publish.empty()) views.push_back(std::make_unique<LiveView>(std::move(publish), bench));
    views.push_back(make_terminal_view(stderr, isatty(STDERR_FILENO) != 0));
    if (json_log_) views.push_back(make_json_log(stdout));
    for (const auto& view : views) runner.observe([&view](const RunState& state) { view->show(state); });

    asio::signal_set signals(io, SIGINT, SIGTERM, SIGHUP);
    signals.async_wait([&runner](const boost::system::error_code& error, int) {
      if (error) return;
      std::signal(SIGINT, SIG_DFL);  // A second Ctrl-C ends the program at once.
      runner.abort();
    });
    std::exception_ptr failure;
    bool met = false;
    auto running = runner.run();
    asio::co_spawn(io, std::move(running), [&](std::exception_ptr why, bool limits_met) {
      failure = why;
      met = limits_met;
      signals.cancel();
      const auto end = [&io] { io.stop(); };
      const auto end_foxglove = [&foxglove, end] { foxglove ? foxglove->finish(end) : end(); };
      live ? live->finish(end_foxglove) : end_foxglove();
    });
    io.run();
    views.clear();
    const double seconds = std::chrono::duration<double>(steady_clock::now() - started).count();
    if (!failure || isatty(STDERR_FILENO) != 0) {
      std::fputs(summary_text(runner.state(), session, seconds).c_str(), stderr);
    }
    if (failure) std::rethrow_exception(failure);
    if (!met)
      throw MeasurementError("not every limit is met; the list above and the report say which and why.");
    return 0;
  }

  std::string procedure_, lidar_, stage_, bench_, out_, operator_;
  std::vector<std::string> settings_;
  bool resume_ = false, dry_run_ = false, yes_ = false, json_log_ = false, accept_lidar_ = false;
  LiveServer::Options live_;
  WebAccess foxglove_;
  CLI::Option *live_option_ = nullptr, *foxglove_option_ = nullptr;
};

}  // namespace

std::unique_ptr<Command> make_run() { return std::make_unique<Run>(); }

}  // namespace rig::commands
