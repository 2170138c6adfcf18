// SPDX-License-Identifier: MIT
#include <algorithm>

#include "rig/runner/runner_impl.hpp"
#include "rig/runner/scan_gate.hpp"
#include "rig/text_lines.hpp"

namespace rig {

fit::CaptureInfo Runner::Impl::info_of(const CaptureRequest& request) {
  fit::CaptureInfo info;
  info.step = request.name;
  info.started_us = time.now_us();
  stage.describe(info);
  info.target = request.target;
  placed.describe(info);
  warn_of_moved(placed.moved_beside(info.target));
  info.first_step = request.first_step;
  info.last_step = request.last_step;
  info.cluster = request.cluster;
  return info;
}

/// Whoever explains the session takes what a capture does not record as the bench file has it.
void Runner::Impl::warn_of_moved(const std::vector<std::string>& targets) {
  if (targets == warned_of_moved) return;
  warned_of_moved = targets;
  if (targets.empty()) return;
  note("warning",
       "A capture records the place of one target; elsewhere than the bench file says stands as well: " +
           listed(targets) +
           ". What the lidar sees of it, `rig explain` takes for misplaced. Put it "
           "back, or name it as the capture's `target`.");
}

awaitable<std::int64_t> Runner::Impl::capture(CaptureRequest request) {
  if (recorded(request.key)) co_return progress.of(request.key).value("capture", std::int64_t{0});
  co_await check_targets();
  control.stop_if_aborted();
  const std::int64_t id = session.begin_capture(info_of(request));
  std::exception_ptr why, lost_at_end;
  long got = 0;
  try {
    co_await fill(id, request, got);
    // The capture is whole: that the lidar is lost now is the next step's trouble.
    try {
      co_await lidar_link.end();
    } catch (...) {
      lost_at_end = std::current_exception();
    }
    replace_short_one(request);
    progress.record(request.key, {{"capture", id}, {"samples", got}});
    session.commit_capture(id);
  } catch (...) {
    why = std::current_exception();
  }
  if (why) {
    progress.withdraw(request.key);
    keep_short(id, request, got);
    std::rethrow_exception(why);
  }
  if (lost_at_end) {
    control.stop_if_aborted();
    co_await lidar_link.reconnect(lost_at_end);
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
    progress.record(request.key + "/short", {{"capture", id}, {"samples", got}, {"asked", request.samples}});
    session.commit_capture(id);
    note("warning",
         request.name + " is short: " + grouped(got) + " of " + grouped(request.samples) + " scans");
  } catch (const std::exception&) {
    // The disk refuses; the capture is lost, as the caller's error says.
    progress.withdraw(request.key + "/short");
  }
}

void Runner::Impl::replace_short_one(const CaptureRequest& request) {
  const json before = progress.of(request.key + "/short");
  if (!before.is_object() || !before.contains("capture")) return;
  session.replace_capture(before["capture"].get<std::int64_t>());
  progress.record(request.key + "/short", json::object());
}

awaitable<void> Runner::Impl::fill(std::int64_t id, const CaptureRequest& request, long& got) {
  const int skip = skip_for(request.spacing_s, known_bench.lidar.scan_hz);
  ScanGate gate(request, known_bench.lidar.scan_hz);
  state().activity = "capturing";
  const bool counts = plan[current].captures <= 1;  // Else the step counts its stops.
  const auto lost_before = parts.lidar.lost(), rejected_before = parts.lidar.rejected();
  int failures = 0;
  std::vector<std::uint16_t> first_mm;
  bool all_alike = true;
  while (got < request.samples) {
    lidar::Scan scan = co_await lidar_link.next(stream_for(request, skip), &gate, failures);
    if (!gate.takes(scan, time.follows_lidar() ? 0 : stage.settled_us())) {
      if (gate.hopeless()) {
        co_await lidar_link.reconnect_for_unfit_scans(request, failures);
      }
      continue;
    }
    failures = 0;
    store(id, got, scan);
    if (got == 0) first_mm = scan.range_mm;
    all_alike = all_alike && scan.range_mm == first_mm;
    ++got;
    if (counts) status.counted(got, request.samples, "scans");
    if (!counts && request.samples >= 200 && got % 40 == 0)
      state().activity = "capturing " + grouped(got) + "/" + grouped(request.samples) + " scans at stop";
    lidar_link.show(scan);
    status.changed();
    parts.lidar.reuse(std::move(scan));
  }
  report_losses(request, parts.lidar.lost() - lost_before, parts.lidar.rejected() - rejected_before);
  if (all_alike) warn_of_frozen_scans(request, first_mm);
}

void Runner::Impl::warn_of_frozen_scans(const CaptureRequest& request,
                                        const std::vector<std::uint16_t>& scan_mm) {
  // A few beams on a quiet lidar may agree by chance.
  constexpr int fewest_scans = 10, fewest_echoes = 100;
  const auto echoes = std::ranges::count_if(scan_mm, [](std::uint16_t mm) { return mm != 0; });
  if (request.samples < fewest_scans || echoes < fewest_echoes || std::exchange(warned_of_frozen, true))
    return;
  note("warning", request.name + ": all " + grouped(request.samples) +
                      " scans are identical in every beam, which no measurement is. The data are frozen or "
                      "simulated: switch the lidar off and on, and look at its scans with `rig check`.");
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
    note("warning", request.name + ": " + std::to_string(lost) + (lost == 1 ? " scan was" : " scans were") +
                        " lost on the way; the capture is complete");
  if (rejected > 0)
    note("warning",
         request.name + ": " + std::to_string(rejected) +
             (rejected == 1 ? " answer with a checksum error was" : " answers with checksum errors were") +
             " discarded");
}

}  // namespace rig
