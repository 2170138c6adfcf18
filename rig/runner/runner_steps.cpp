// SPDX-License-Identifier: MIT
// What a step may ask of a run, but for captures and prompts.
#include <algorithm>
#include <cmath>
#include <filesystem>

#include "rig/runner/runner_impl.hpp"
#include "rig/session/standing.hpp"

namespace rig {
namespace {

constexpr int waits_begun_again = 3;

}  // namespace

awaitable<void> Runner::Impl::checkpoint(long done, long total) {
  state().done = done;
  state().total = total;
  if (total > 0) state().unit = "stops";
  status.changed();
  control.stop_if_aborted();
  if (!control.paused()) co_return;
  note("info", "paused");
  const auto before = state().phase;
  state().phase = RunState::Phase::paused;
  state().pausing = false;
  status.changed();
  const std::int64_t paused_us = parts.clock.host_us();
  co_await control.until_resumed();
  status.paused_for(parts.clock.host_us() - paused_us);
  state().phase = before;
  control.stop_if_aborted();
  note("info", "resumed by the operator");
}

void Runner::Impl::set(const std::string& variable, const Value& value) {
  variables[variable] = value;
  outputs[variable] = json_of(value);
}

void Runner::Impl::skip_rest_of_iteration() {
  if (!plan[current].turns.empty()) skipped_turns.insert(plan[current].turns.back());
}

awaitable<json> Runner::Impl::fit(std::string kind, json options) {
  if (!parts.fit) throw UsageError("this program cannot fit '" + kind + "' yet.");
  status.doing("fit " + kind);
  session.demand_name();  // The worker opens the file by its name: a connection belongs to one thread.
  auto computing_it =
      worker.compute([fit = parts.fit, file = session.path(), kind, options = std::move(options)] {
        const SessionStore recorded_so_far(file, SessionStore::Mode::read);
        return fit(kind, recorded_so_far, options);
      });
  json result = co_await std::move(computing_it);
  session.add_result(kind, result.dump(-1, ' ', false, json::error_handler_t::replace));
  session.demand_name();
  for (const std::string& doubt : doubts_of(result)) note("warning", "DOUBTFUL: " + kind + ": " + doubt);
  if (!procedure.limits.empty())
    state().checks_text = check_limits(procedure.limits, session)["checks"].dump();
  status.changed();
  co_return result;
}

awaitable<void> Runner::Impl::report(std::string file) {
  if (!parts.report) throw UsageError("this program cannot write reports yet.");
  std::string target = report_target(file);
  state().activity = "report to " + file;
  store_limits();
  if (std::all_of(plan.begin() + static_cast<std::ptrdiff_t>(current), plan.end(),
                  [](const PlannedStep& step) { return step.step->kind->only_reports(); }))
    session.set("ended", ended_but_for_reports);
  status.changed();
  session.demand_name();  // The report is made from the file.
  auto writing = worker.compute([report = parts.report, session_file = session.path(), target] {
    return report(session_file, target);
  });
  const RunnerParts::Written written = co_await std::move(writing);
  if (!written.certificates.empty()) session.set("certificates", written.certificates);
  if (!written.file.empty() && written.file != target)
    note("warning", target + " was there already and is kept: the report is " + written.file);
  note("info", "report written to " + (written.file.empty() ? target : written.file));
  state().report = written.file.empty() ? target : written.file;
}

std::string Runner::Impl::report_target(const std::string& file) const {
  const auto folder = std::filesystem::absolute(session.path()).parent_path();
  const auto target = folder / file;
  // Links are followed before it is judged where the report would go.
  const auto inside = std::filesystem::weakly_canonical(folder),
             really = std::filesystem::weakly_canonical(target);
  const bool leaves = std::ranges::mismatch(inside, really).in1 != inside.end();
  if (leaves || std::filesystem::is_symlink(target))
    throw UsageError(
        "the report '" + file + "' would be written to " + really.string() +
        ", outside the session's folder " + inside.string() +
        ". It was not written; what was measured is in the session. Remove the link, or use rig report.");
  return target.string();
}

void Runner::Impl::for_each_scan(std::int64_t capture,
                                 const std::function<void(const fit::ScanView&)>& visit) const {
  session.for_each_scan(capture, visit);
}

awaitable<void> Runner::Impl::home(bool again) { co_await stage.home(again); }

awaitable<double> Runner::Impl::move_to(double target_deg, int approach, const FilePosition& written_at) {
  co_return co_await stage.move_to(target_deg, approach, written_at);
}

awaitable<void> Runner::Impl::wait(double seconds) {
  LidarStream stream;
  stream.first_step = stream.last_step = known_bench.lidar.front_step;
  stream.skip = 9;
  std::optional<std::int64_t> begun_us;
  state().activity = "waiting";
  int failures = 0, begun_again = 0, restarts = lidar_link.clock_restarts();
  for (double passed_s = 0; passed_s < seconds;) {
    const lidar::Scan scan = co_await lidar_link.next(stream, nullptr, failures);
    failures = 0;
    // The time that the host counts: a stamp of the lidar's says nothing after a restart of its clock.
    (void)time.place_us(scan);
    const std::int64_t host_us = time.now_us();
    const bool restarted =
        std::exchange(restarts, lidar_link.clock_restarts()) != lidar_link.clock_restarts();
    if (begun_us && restarted) {
      if (++begun_again > waits_begun_again)
        throw DeviceError("The lidar restarted " + std::to_string(begun_again) +
                          " times during the wait. Check its power supply and its cable.");
      note("warning", "the wait of " + to_text(seconds) + " s begins again, " +
                          rounded_text(static_cast<double>(host_us - *begun_us) / 1e6, 0) +
                          " s after it began: the lidar may have cooled");
      begun_us.reset();
    }
    if (!begun_us) begun_us = host_us;
    passed_s = static_cast<double>(host_us - *begun_us) / 1e6;
    status.counted(std::lround(passed_s), std::lround(seconds), "s");
    status.changed();
  }
  co_await lidar_link.stop();
}

}  // namespace rig
