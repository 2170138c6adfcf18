// SPDX-License-Identifier: MIT
#include <boost/asio/experimental/awaitable_operators.hpp>
#include <cmath>

#include "rig/runner/runner_impl.hpp"
#include "rig/runner/scan_gate.hpp"
#include "rig/runner/turn_track.hpp"

namespace rig {
namespace {

using namespace asio::experimental::awaitable_operators;

constexpr double turn_run_up_s = 0.5;

}  // namespace

awaitable<std::int64_t> Runner::Impl::capture_turning(CaptureRequest request, double from_deg,
                                                      const FilePosition& written_at) {
  if (recorded(request.key)) co_return progress.of(request.key).value("capture", std::int64_t{0});
  const double rate_deg_s = *request.rate_deg_s;
  TurningScans turned;
  for (int attempt = 1;; ++attempt) {
    auto going = move_to(from_deg, rate_deg_s > 0 ? 1 : -1, written_at);
    co_await std::move(going);
    co_await check_targets();
    std::exception_ptr why;
    turned = TurningScans();
    try {
      // Scans and the stage's track are dated by two clocks: a millisecond between them is an error of rate x
      // 1 ms in every angle.
      co_await lidar_link.stop();
      co_await parts.lidar.synchronise();
      co_await stage.turn(rate_deg_s);
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
      // Whose angles nobody knows are no measurement, not even a short one.
      if (!is_a<UnsteadyTurn>(why)) keep_short_turning(request, turned);
      std::rethrow_exception(why);
    }
  }
  const std::int64_t id = store_turning(request, turned, "");
  // Nothing that the lidar does now may keep the stage turning.
  co_await stage.stop_turning();
  co_await lidar_link.stop();
  co_return id;
}

awaitable<void> Runner::Impl::recover_turn(std::exception_ptr why, int attempt) {
  const bool lidar_lost = is_lidar_lost(why);
  if (control.aborted() || attempt >= stage_attempts || (!lidar_lost && !is_stage_error(why)))
    std::rethrow_exception(why);
  if (!lidar_lost) note("warning", "stage: " + words_of(why));
  note("warning", "the turn is stopped and repeated from its start");
  co_await stage.stop_turning();
  control.stop_if_aborted();
  if (lidar_lost) {
    co_await lidar_link.reconnect(why);
  } else {
    auto recovering = stage.recover(attempt, false);  // Which homes it if it lost its reference.
    co_await std::move(recovering);
    co_await lidar_link.stop();
  }
}

awaitable<void> Runner::Impl::fill_turning(const CaptureRequest& request, TurningScans& turned) {
  ScanGate gate(request, known_bench.lidar.scan_hz);
  gate.restart(lidar_link.seen_ms());
  const auto lost_before = parts.lidar.lost(), rejected_before = parts.lidar.rejected();
  const std::int64_t begun_us = parts.clock.host_us();
  const std::int64_t ready_us = begun_us + static_cast<std::int64_t>(1e6 * turn_run_up_s);
  const double longest_s =
      stage.room_deg(*request.rate_deg_s) / std::abs(*request.rate_deg_s);  // or infinity
  co_await lidar_link.start(stream_for(request, 0));
  while (turned.scans.size() < static_cast<std::size_t>(request.samples)) {
    control.stop_if_aborted();
    const double passed_s = static_cast<double>(parts.clock.host_us() - begun_us) / 1e6;
    lidar::Scan scan = co_await next_scan_before_limit(longest_s - passed_s);
    if (!gate.takes(scan, ready_us)) {
      if (gate.hopeless()) throw DeviceError(LidarLink::unfit_scans(request));
      continue;
    }
    lidar_link.show(scan);
    turned.scans.push_back(std::move(scan));
    status.counted(static_cast<long>(turned.scans.size()), request.samples, "scans");
    status.changed();
    if (turned.scans.size() % 4 == 1) {
      co_await track_stage(turned.track);
    }
  }
  co_await track_stage(turned.track);
  const std::string disturbance =
      turned.track.disturbance(*request.rate_deg_s, known_bench.stage_resolution_rad * fit::deg_per_rad);
  if (!disturbance.empty())
    throw UnsteadyTurn(disturbance +
                       ". Check that nothing blocks it, that it carries its load at this rate, and that it "
                       "reaches the rate within half a second.");
  report_losses(request, parts.lidar.lost() - lost_before, parts.lidar.rejected() - rejected_before);
}

awaitable<lidar::Scan> Runner::Impl::next_scan_before_limit(double seconds) {
  std::exception_ptr why;
  lidar::Scan scan;
  bool at_limit = seconds <= 0;
  if (!std::isfinite(seconds)) {
    scan = co_await parts.lidar.next();
  } else if (!at_limit) {
    auto reading = read_quietly(scan, why);
    auto turning = parts.clock.sleep(seconds);
    const auto first = co_await (std::move(reading) || std::move(turning));
    at_limit = first.index() == 1;
  }
  if (at_limit) {
    // Only now: beside the reading, the next scan would call the stop off half-way.
    co_await stage.stop_turning();
    throw MeasurementError(
        "The turning stage reached its soft limit before the lidar had sent all requested scans, and was "
        "stopped. Find out what delayed the scans (the session's events).");
  }
  if (why) std::rethrow_exception(why);
  lidar_link.report_clock_restart(scan);
  co_return scan;
}

awaitable<void> Runner::Impl::read_quietly(lidar::Scan& scan, std::exception_ptr& why) {
  try {
    scan = co_await parts.lidar.next();
  } catch (...) {
    why = std::current_exception();
  }
}

awaitable<void> Runner::Impl::track_stage(TurnTrack& track) {
  const std::int64_t before_us = parts.clock.host_us();
  const double deg = co_await stage.turned_to();
  const std::int64_t after_us = parts.clock.host_us();
  const std::int64_t middle_us = time.at_us((before_us + after_us) / 2);
  track.add(static_cast<double>(middle_us) / 1e6, deg, static_cast<double>(after_us - before_us) / 2e6);
  fit::TrackPose pose;
  pose.host_us = middle_us;
  pose.stage_rad = deg * fit::rad_per_deg;
  session.add_pose(pose);
}

std::int64_t Runner::Impl::store_turning(const CaptureRequest& request, const TurningScans& turned,
                                         const std::string& mark) {
  const auto& [scans, track] = turned;
  fit::CaptureInfo info = info_of(request);
  info.started_us = time.place_us(scans.front());
  placed.describe(info);
  const auto [start_deg, rate_deg_s] = track.line_at(static_cast<double>(info.started_us) / 1e6);
  info.stage_rad = start_deg * fit::rad_per_deg;
  info.stage_readback_rad.reset();
  info.approach = rate_deg_s > 0 ? 1 : -1;
  info.stage_rate_rad_s = rate_deg_s * fit::rad_per_deg;
  const std::int64_t id = session.begin_capture(info);
  try {
    for (std::size_t i = 0; i < scans.size(); ++i) store(id, static_cast<long>(i), scans[i]);
    replace_short_one(request);
    if (!mark.empty()) session.mark_short(id);
    progress.record(request.key + mark,
                    {{"capture", id}, {"samples", scans.size()}, {"asked", request.samples}});
    session.commit_capture(id);
  } catch (...) {
    progress.withdraw(request.key + mark);
    session.abandon_capture(id);
    throw;
  }
  return id;
}

void Runner::Impl::keep_short_turning(const CaptureRequest& request, const TurningScans& turned) {
  const std::vector<lidar::Scan>& scans = turned.scans;
  if (scans.empty() || turned.track.size() < 2) return;
  try {
    (void)store_turning(request, turned, "/short");
    note("warning", request.name + " is short: " + grouped(static_cast<long>(scans.size())) + " of " +
                        grouped(request.samples) + " scans");
  } catch (const std::exception&) {
    // The disk refuses; the caller's error says so.
  }
}

}  // namespace rig
