// SPDX-License-Identifier: MIT
#include <boost/asio/experimental/awaitable_operators.hpp>
#include <cmath>

#include "rig/runner/runner_impl.hpp"
#include "rig/runner/scan_gate.hpp"

namespace rig {
namespace {

using namespace asio::experimental::awaitable_operators;

constexpr double turn_run_up_s = 0.5;
constexpr int waits_begun_again = 3;

}  // namespace

fit::CaptureInfo Runner::Impl::info_of(const CaptureRequest& request) {
  fit::CaptureInfo info;
  info.step = request.name;
  info.started_us = time.now_us();
  info.stage_rad = position_deg * fit::rad_per_deg;
  info.stage_readback_rad = readback_deg * fit::rad_per_deg;
  info.approach = last_approach;
  info.target = request.target;
  placed.describe(info);
  info.first_step = request.first_step;
  info.last_step = request.last_step;
  info.cluster = request.cluster;
  return info;
}

awaitable<std::int64_t> Runner::Impl::capture(CaptureRequest request) {
  if (recorded(request.key)) co_return progress_of(request.key).value("capture", std::int64_t{0});
  co_await check_targets();
  stop_if_aborted();
  const std::int64_t id = session.begin_capture(info_of(request));
  std::exception_ptr why, lost_at_end;
  long got = 0;
  try {
    co_await fill(id, request, got);
    // The capture is whole: that the lidar is lost now is the next step's trouble.
    try {
      co_await end_stream();
    } catch (...) {
      lost_at_end = std::current_exception();
    }
    replace_short_one(request);
    record(request.key, {{"capture", id}, {"samples", got}});
    session.commit_capture(id);
  } catch (...) {
    why = std::current_exception();
  }
  if (why) {
    progress.erase(request.key);
    keep_short(id, request, got);
    std::rethrow_exception(why);
  }
  if (lost_at_end) {
    stop_if_aborted();
    co_await reconnect_lidar(lost_at_end);
  }
  co_return id;
}

void Runner::Impl::keep_short(std::int64_t id, const CaptureRequest& request, long got) {
  try {
    if (got == 0) {
      session.abandon_capture(id);
      return;
    }
    replace_short_one(request);
    session.mark_short(id);
    record(request.key + "/short", {{"capture", id}, {"samples", got}, {"asked", request.samples}});
    session.commit_capture(id);
    note("warning",
         request.name + " is short: " + grouped(got) + " of " + grouped(request.samples) + " scans");
  } catch (const std::exception&) {
    // The disk refuses; the capture is lost, as the caller's error says.
    progress.erase(request.key + "/short");
  }
}

void Runner::Impl::replace_short_one(const CaptureRequest& request) {
  const json before = progress_of(request.key + "/short");
  if (!before.is_object() || !before.contains("capture")) return;
  session.replace_capture(before["capture"].get<std::int64_t>());
  record(request.key + "/short", json::object());
}

awaitable<void> Runner::Impl::fill(std::int64_t id, const CaptureRequest& request, long& got) {
  const int skip = skip_for(request.spacing_s, known_bench.lidar.scan_hz);
  ScanGate gate(request, known_bench.lidar.scan_hz);
  state.activity = "capturing";
  const bool counts = plan[current].captures <= 1;  // Else the step counts its stops.
  const auto lost_before = parts.lidar.lost(), rejected_before = parts.lidar.rejected();
  int failures = 0;
  while (got < request.samples) {
    lidar::Scan scan = co_await next_scan(stream_for(request, skip), &gate, failures);
    if (!gate.takes(scan, time.follows_lidar() ? 0 : settled_us)) {
      if (gate.hopeless()) {
        co_await reconnect_for_unfit_scans(request, failures);
      }
      continue;
    }
    failures = 0;
    store(id, got, scan);
    ++got;
    if (counts) state.done = got, state.total = request.samples, state.unit = "scans";
    if (!counts && request.samples >= 200 && got % 40 == 0)
      state.activity = "capturing " + grouped(got) + "/" + grouped(request.samples) + " scans at stop";
    show(scan);
    changed();
    parts.lidar.reuse(std::move(scan));
  }
  report_losses(request, parts.lidar.lost() - lost_before, parts.lidar.rejected() - rejected_before);
}

std::string Runner::Impl::unfit_scans(const CaptureRequest& request) {
  return "The lidar sends scans that do not belong to the capture (steps other than " +
         std::to_string(request.first_step) + " to " + std::to_string(request.last_step) +
         ", or time stamps that do not advance). None was stored. Switch it off and on, then continue with "
         "rig resume.";
}

awaitable<void> Runner::Impl::reconnect_for_unfit_scans(const CaptureRequest& request, int& failures) {
  if (++failures > failures_without_scan) throw DeviceError(unfit_scans(request));
  co_await reconnect_lidar(std::make_exception_ptr(
      DeviceError("its scans are of other steps, or their time stamps do not advance")));
}

void Runner::Impl::store(std::int64_t id, long seq, const lidar::Scan& scan) {
  fit::ScanView view;
  view.seq = seq;
  view.device_ms = static_cast<std::int64_t>(scan.device_ms);
  view.host_us = time.place_us(scan);
  view.range_mm = scan.range_mm;
  view.intensity = scan.intensity;
  session.add_scan(id, view);
}

void Runner::Impl::report_losses(const CaptureRequest& request, std::uint64_t lost, std::uint64_t rejected) {
  if (lost > 0)
    note("warning",
         request.name + ": " + std::to_string(lost) + " scans were lost on the way; the capture is complete");
  if (rejected > 0)
    note("warning",
         request.name + ": " + std::to_string(rejected) + " answers with checksum errors were discarded");
}

awaitable<std::int64_t> Runner::Impl::capture_turning(CaptureRequest request, double from_deg,
                                                      const FilePosition& place) {
  if (recorded(request.key)) co_return progress_of(request.key).value("capture", std::int64_t{0});
  const double rate_deg_s = *request.rate_deg_s;
  TurningScans turned;
  for (int attempt = 1;; ++attempt) {
    auto going = move_to(from_deg, rate_deg_s > 0 ? 1 : -1, place);
    co_await std::move(going);
    co_await check_targets();
    std::exception_ptr why;
    turned = TurningScans();
    try {
      // Scans and the stage's track are dated by two clocks: a millisecond between them is an error of rate x
      // 1 ms in every angle.
      co_await stop_stream();
      co_await parts.lidar.synchronise();
      co_await turn(rate_deg_s);
      co_await fill_turning(request, turned);
    } catch (...) {
      why = std::current_exception();
    }
    if (!why) break;
    // The stage stands before anything else; then the attempt is judged.
    try {
      co_await recover_turn(why, attempt);
      why = nullptr;
    } catch (...) {
      why = std::current_exception();
    }
    if (why) {
      keep_short_turning(request, turned);
      std::rethrow_exception(why);
    }
  }
  const std::int64_t id = store_turning(request, turned, "");
  // Nothing that the lidar does now may keep the stage turning.
  co_await stop_turning_for_sure();
  co_await stop_stream();
  co_return id;
}

awaitable<void> Runner::Impl::recover_turn(std::exception_ptr why, int attempt) {
  const bool lidar_lost = is_lidar_lost(why);
  if (aborted || attempt >= stage_attempts || (!lidar_lost && !is_stage_error(why)))
    std::rethrow_exception(why);
  if (!lidar_lost) note("warning", "stage: " + words_of(why));
  note("warning", "the turn is stopped and repeated from its start");
  co_await stop_turning_for_sure();
  stop_if_aborted();
  if (lidar_lost) {
    co_await reconnect_lidar(why);
  } else {
    auto recovering = recover_stage(attempt, false);  // Which homes it if it lost its reference.
    co_await std::move(recovering);
    co_await stop_stream();
  }
}

awaitable<void> Runner::Impl::fill_turning(const CaptureRequest& request, TurningScans& turned) {
  ScanGate gate(request, known_bench.lidar.scan_hz);
  gate.restart(seen_ms);
  const auto lost_before = parts.lidar.lost(), rejected_before = parts.lidar.rejected();
  const std::int64_t begun_us = parts.clock.host_us();
  const std::int64_t ready_us = begun_us + static_cast<std::int64_t>(1e6 * turn_run_up_s);
  const double room_deg =
      request.rate_deg_s > 0 ? limits.max_deg - position_deg : position_deg - limits.min_deg;
  const double longest_s = room_deg / std::abs(*request.rate_deg_s);
  co_await start_stream(stream_for(request, 0));
  while (turned.scans.size() < static_cast<std::size_t>(request.samples)) {
    stop_if_aborted();
    const double passed_s = static_cast<double>(parts.clock.host_us() - begun_us) / 1e6;
    lidar::Scan scan = co_await next_scan_before_limit(longest_s - passed_s);
    if (!gate.takes(scan, ready_us)) {
      if (gate.hopeless()) throw DeviceError(unfit_scans(request));
      continue;
    }
    show(scan);
    turned.scans.push_back(std::move(scan));
    state.done = static_cast<long>(turned.scans.size()), state.total = request.samples, state.unit = "scans";
    changed();
    if (turned.scans.size() % 4 == 1) {
      co_await track_stage(turned.track);
    }
  }
  co_await track_stage(turned.track);
  report_losses(request, parts.lidar.lost() - lost_before, parts.lidar.rejected() - rejected_before);
}

awaitable<lidar::Scan> Runner::Impl::next_scan_before_limit(double seconds) {
  std::exception_ptr why;
  lidar::Scan scan;
  auto reading = read_quietly(scan, why);
  auto stopping = stop_stage_after(seconds);
  const auto first = co_await (std::move(reading) || std::move(stopping));
  if (first.index() == 1)
    throw MeasurementError(
        "The turning stage reached its soft limit before the lidar had sent all requested scans, and was "
        "stopped. Find out what delayed the scans (the session's events), then continue with rig resume.");
  if (why) std::rethrow_exception(why);
  co_return scan;
}

awaitable<void> Runner::Impl::read_quietly(lidar::Scan& scan, std::exception_ptr& why) {
  try {
    scan = co_await parts.lidar.next();
  } catch (...) {
    why = std::current_exception();
  }
}

awaitable<void> Runner::Impl::stop_stage_after(double seconds) {
  if (seconds > 0) {
    co_await parts.clock.sleep(seconds);
  }
  co_await parts.stage.stop();
}

awaitable<void> Runner::Impl::track_stage(Track& track) {
  const std::int64_t before_us = parts.clock.host_us();
  const StageStatus status = co_await stage_status();
  const std::int64_t middle_us = time.at_us((before_us + parts.clock.host_us()) / 2);
  if (status.position_deg < limits.min_deg || status.position_deg > limits.max_deg)
    throw MeasurementError("The turning stage passed its soft limits at " + in_deg(status.position_deg) +
                           " and was stopped. Lower the rate or the number of samples.");
  position_deg = status.position_deg;
  track.add(static_cast<double>(middle_us) / 1e6, status.position_deg);
  fit::TrackPose pose;
  pose.host_us = middle_us;
  pose.stage_rad = status.position_deg * fit::rad_per_deg;
  session.add_pose(pose);
}

std::int64_t Runner::Impl::store_turning(const CaptureRequest& request, const TurningScans& turned,
                                         const std::string& mark) {
  const auto& [scans, track] = turned;
  fit::CaptureInfo info = info_of(request);
  info.started_us = time.place_us(scans.front());
  placed.describe(info);
  const auto [start_deg, rate_deg_s] = track.at_and_rate(static_cast<double>(info.started_us) / 1e6);
  info.stage_rad = start_deg * fit::rad_per_deg;
  info.stage_readback_rad.reset();
  info.approach = rate_deg_s > 0 ? 1 : -1;
  info.stage_rate_rad_s = rate_deg_s * fit::rad_per_deg;
  const std::int64_t id = session.begin_capture(info);
  try {
    for (std::size_t i = 0; i < scans.size(); ++i) store(id, static_cast<long>(i), scans[i]);
    replace_short_one(request);
    if (!mark.empty()) session.mark_short(id);
    record(request.key + mark, {{"capture", id}, {"samples", scans.size()}, {"asked", request.samples}});
    session.commit_capture(id);
  } catch (...) {
    progress.erase(request.key + mark);
    session.abandon_capture(id);
    throw;
  }
  return id;
}

void Runner::Impl::keep_short_turning(const CaptureRequest& request, const TurningScans& turned) {
  const std::vector<lidar::Scan>& scans = turned.scans;
  if (scans.empty() || turned.track.time_s.size() < 2) return;
  try {
    (void)store_turning(request, turned, "/short");
    note("warning", request.name + " is short: " + grouped(static_cast<long>(scans.size())) + " of " +
                        grouped(request.samples) + " scans");
  } catch (const std::exception&) {
    // The disk refuses; the caller's error says so.
  }
}

awaitable<void> Runner::Impl::wait(double seconds) {
  LidarStream stream;
  stream.first_step = stream.last_step = known_bench.lidar.front_step;
  stream.skip = 9;
  std::optional<std::int64_t> begun_us;
  state.activity = "waiting";
  int failures = 0, begun_again = 0, restarts = clock_restarts;
  for (double passed_s = 0; passed_s < seconds;) {
    const lidar::Scan scan = co_await next_scan(stream, nullptr, failures);
    failures = 0;
    // The time that the host counts: a stamp of the lidar's says nothing after a restart of its clock.
    (void)time.place_us(scan);
    const std::int64_t host_us = time.now_us();
    const bool restarted = std::exchange(restarts, clock_restarts) != clock_restarts;
    if (begun_us && restarted) {
      if (++begun_again > waits_begun_again)
        throw DeviceError(
            "The lidar restarted " + std::to_string(begun_again) +
            " times during the warm-up. Check its power supply and its cable, then continue with --resume.");
      note("warning", "the wait of " + to_text(seconds) + " s begins again, " +
                          rounded_text(static_cast<double>(host_us - *begun_us) / 1e6, 0) +
                          " s after it began: the lidar may have cooled");
      begun_us.reset();
    }
    if (!begun_us) begun_us = host_us;
    passed_s = static_cast<double>(host_us - *begun_us) / 1e6;
    state.done = std::lround(passed_s), state.total = std::lround(seconds), state.unit = "s";
    changed();
  }
  co_await stop_stream();
}

}  // namespace rig
