// SPDX-License-Identifier: MIT
#include <algorithm>
#include <boost/asio/bind_cancellation_slot.hpp>
#include <boost/asio/cancellation_signal.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <cstdio>

#include "rig/commands/json_output.hpp"
#include "rig/runner/bench_check.hpp"
#include "rig/runner/bench_file.hpp"
#include "rig/runner/device_lock.hpp"
#include "rig/runner/failures.hpp"
#include "rig/runner/operators.hpp"
#include "rig/runner/scip_source.hpp"
#include "rig/stage/stage_patience.hpp"

namespace rig::commands {
namespace {

namespace asio = boost::asio;
using nlohmann::json;

const char* word(CheckLine::Verdict verdict) {
  switch (verdict) {
    case CheckLine::Verdict::good:
      return "good";
    case CheckLine::Verdict::note:
      return "note";
    case CheckLine::Verdict::bad:
      return "BAD";
  }
  return "";
}

void print(const CheckLine& line) {
  std::fprintf(stderr, "%-4s  %-16s %s\n", word(line.verdict), line.what.c_str(), line.says.c_str());
  if (line.verdict != CheckLine::Verdict::good)
    std::fprintf(stderr, "      %-16s -> %s\n", "", line.remedy.c_str());
}

class Check : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* check = root.add_subcommand("check", "Checks the bench before a long run and says what to correct");
    check->add_option("--lidar", lidar_, "tcp://HOST[:PORT]")->required();
    check->add_option("--stage", stage_, "serial:PATH[?language=zaber&baud=...]")->required();
    check->add_option("--bench", bench_, "Bench file")->required();
    check->add_flag("--stay-still", stay_still_, "Do not home or move the stage");
    json_.declare(*check, "what was found", "check");
    return check;
  }

  int run() override {
    check_outputs({json_.output()}, {bench_});
    const fit::Bench bench = read_bench_file(bench_);
    const Endpoint address = parse_endpoint(lidar_, "--lidar", 10940);
    DeviceLocks locks("rig check");
    locks.lock("lidar", address.host + ":" + std::to_string(address.port));
    const StageOptions options = bench_stage_options(bench);
    asio::io_context io(1);
    std::exception_ptr failure;
    asio::signal_set signals(io, SIGINT, SIGTERM);
    bool stopped = false;
    auto checking = walk(bench, address, options);
    // Cancellation reaches whatever waits; the drivers end in a stop.
    asio::cancellation_signal cancel;
    signals.async_wait([&](const boost::system::error_code& error, int) {
      if (!error) stopped = true, cancel.emit(asio::cancellation_type::terminal);
    });
    asio::co_spawn(io, std::move(checking),
                   asio::bind_cancellation_slot(cancel.slot(), [&](std::exception_ptr why) {
                     failure = why;
                     signals.cancel();
                   }));
    io.run();
    if (stopped) failure = std::make_exception_ptr(MeasurementError("Stopped by the operator."));
    if (unstopped_)
      failure = failure ? with_more_words(failure, "The stage could not be stopped: " + sentence(unstopped_))
                        : unstopped_;
    json_.write(document(failure));
    if (failure) std::rethrow_exception(failure);
    if (std::ranges::any_of(lines_,
                            [](const CheckLine& line) { return line.verdict == CheckLine::Verdict::bad; }))
      throw MeasurementError("the bench is not ready: correct what is marked BAD and check again.");
    return 0;
  }

 private:
  asio::awaitable<void> walk(const fit::Bench& bench, Endpoint address, StageOptions options) {
    const auto executor = co_await asio::this_coro::executor;
    const auto lidar = make_scip_source(executor, address);
    const auto clock = make_real_clock();
    const auto stage = co_await open_stage_patiently(executor, stage_, options);
    std::exception_ptr failure;
    try {
      const std::function<void(const CheckLine&)> show = [this](const CheckLine& line) {
        print(line);
        lines_.push_back(line);
      };
      co_await check_bench(bench, *lidar, *stage, *clock, stay_still_, show);
    } catch (...) {
      failure = std::current_exception();
    }
    co_await asio::this_coro::reset_cancellation_state(asio::disable_cancellation());
    try {
      co_await stage->stop();
    } catch (...) {
      unstopped_ = std::current_exception();
    }
    if (failure) std::rethrow_exception(failure);
  }

  /// What was found, also where a device ended the walk: then `error` says how.
  [[nodiscard]] json document(const std::exception_ptr& failure) const {
    json found = {{"schema", "check/1"}, {"lines", json::array()}};
    for (const CheckLine& line : lines_) {
      json entry = {{"what", line.what}, {"verdict", word(line.verdict)}, {"says", line.says}};
      if (line.verdict != CheckLine::Verdict::good) entry["remedy"] = line.remedy;
      found["lines"].push_back(std::move(entry));
    }
    try {
      if (failure) std::rethrow_exception(failure);
    } catch (const std::exception& error) {
      found["error"] = error.what();
    }
    return found;
  }

  std::string lidar_, stage_, bench_;
  JsonOutput json_;
  bool stay_still_ = false;
  std::vector<CheckLine> lines_;
  std::exception_ptr unstopped_;  ///< Why the stage could not be stopped in the end.
};

}  // namespace

std::unique_ptr<Command> make_check() { return std::make_unique<Check>(); }

}  // namespace rig::commands
