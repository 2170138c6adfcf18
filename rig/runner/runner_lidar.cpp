// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "fit/number_format.hpp"
#include "rig/runner/device_lock.hpp"
#include "rig/runner/lidar_doubts.hpp"
#include "rig/runner/runner_impl.hpp"
#include "rig/runner/scan_gate.hpp"
#include "rig/session/standing.hpp"
#include "rig/text_lines.hpp"

namespace rig {
namespace {

/// A lidar that is switched on with its network switch takes longer than one that comes back.
constexpr double longest_start_s = 30, first_start_pause_s = 1, longest_start_pause_s = 5;
constexpr int connect_attempts = 4;  // 0.5, 1, 2, 4 s apart: an UST-10LX is back about 3 s after power-up.

}  // namespace

awaitable<void> Runner::Impl::start_stream(LidarStream stream) {
  co_await parts.lidar.start(stream);
  streaming = true;
  if (stream.intensity && !parts.lidar.sends_intensities() && !std::exchange(intensities_missed, true))
    note("warning",
         "this lidar sends no intensities (it does not know the command ME): distances alone are stored");
}

awaitable<void> Runner::Impl::end_stream() {
  if (!streaming) co_return;
  streaming = false;
  co_await parts.lidar.stop();
}

awaitable<void> Runner::Impl::stop_stream() {
  std::exception_ptr why;
  try {
    co_await end_stream();
  } catch (...) {
    why = std::current_exception();
  }
  if (!why) co_return;
  stop_if_aborted();
  co_await reconnect_lidar(why);
}

awaitable<lidar::Scan> Runner::Impl::next_scan(LidarStream stream, ScanGate* gate, int& failures) {
  for (;;) {
    stop_if_aborted();
    std::exception_ptr why;
    lidar::Scan scan;
    try {
      if (!streaming) {
        if (gate) gate->restart(seen_ms);
        co_await start_stream(stream);
      }
      scan = co_await parts.lidar.next();
    } catch (...) {
      why = std::current_exception();
    }
    if (!why) {
      report_clock_restart(scan);
      co_return scan;
    }
    stop_if_aborted();
    if (++failures > failures_without_scan) std::rethrow_exception(why);
    co_await reconnect_lidar(why);
  }
}

void Runner::Impl::report_clock_restart(const lidar::Scan& scan) {
  const bool asked_for = std::exchange(power_cycle_announced, false);
  if (parts.lidar.clock_restarts() == clock_restarts) return;
  clock_restarts = parts.lidar.clock_restarts();
  json all = json::parse(session.get("lidar_restarts").value_or("[]"), nullptr, false);
  if (!all.is_array()) all = json::array();
  all.push_back({{"host_us", time.place_us(scan)}, {"device_ms", scan.device_ms}});
  session.set("lidar_restarts", all.dump());
  const std::string goes_on =
      "the lidar's clock started again: time stamps (device_ms) of later scans have a new time base, "
      "continued by this computer's clock";
  if (asked_for) return note("info", goes_on);
  note("warning",
       goes_on +
           ". The lidar restarted or its power was cut: if it was off for long it has cooled, and its "
           "warm-up is not repeated automatically" +
           (placed.power_on_us() ? "; captures still count the time since power-on from before" : "") +
           ". Check its power supply.");
}

void Runner::Impl::judge_lidar(const json& identity) {
  std::string differs, doubtful, remedies;
  bool is_ill = false;
  for (const LidarDoubt& doubt : doubts_of_lidar(identity, known_bench)) {
    if (doubt.weight == LidarDoubt::Weight::note) continue;
    const bool refused = doubt.weight == LidarDoubt::Weight::refusal, of_health = doubt.what == lidar_state;
    // The session has its lidar: its serial number is what counts.
    if (!refused && !of_health && session.get("lidar")) continue;
    std::string& text = refused ? differs : doubtful;
    text += (text.empty() ? "" : ", ") + doubt.says;
    is_ill |= of_health;
    if (!refused) remedies += " " + doubt.remedy;
  }
  const std::string who = "the lidar" + (parts.lidar.address().empty() ? "" : " at " + parts.lidar.address());
  if (!differs.empty())
    throw UsageError("The bench file describes a lidar other than " + who + ": " + differs +
                     ". Correct 'lidar' in the bench file, or connect the lidar that it describes.");
  if (doubtful.empty() || doubtful == lidar_accepted) return;
  if (!parts.accepts_lidar) {
    const std::string why =
        "About " + who + ": " + doubtful + "." + remedies +
        " To measure with it all the same, give --accept-lidar; the session then says so.";
    if (is_ill) throw DeviceError(why);
    throw UsageError(why);
  }
  lidar_accepted = doubtful;
  session.set("lidar_accepted", doubtful);
  note("warning",
       "measured by the operator's decision (--accept-lidar) despite this about " + who + ": " + doubtful);
}

awaitable<void> Runner::Impl::connect_lidar() {
  const json identity = co_await parts.lidar.connect();
  judge_lidar(identity);
  if (parts.locks) parts.locks->lock_lidar(identity);
  lidar_is_simulated = says_simulated(identity.dump());
  connected = true;
  seen_ms.reset();
  const auto before = session.get("lidar");
  if (!before) {
    session.set("lidar", identity.dump());
    co_return;
  }
  const auto serial = [](const json& who) {
    if (who.contains("SERI")) return who["SERI"].dump();
    for (const auto& part : who)
      if (part.is_object() && part.contains("SERI")) return part["SERI"].dump();
    return std::string();
  };
  const json known = json::parse(*before, nullptr, false);
  if (serial(known) != serial(identity))
    throw DeviceError("This is another lidar (" + serial(identity) +
                      ") than the one the session was begun with (" + serial(known) +
                      "). Connect that one, or begin a new session.");
}

awaitable<void> Runner::Impl::await_lidar() {
  const std::int64_t begun_us = parts.clock.host_us();
  bool said_why = false;
  for (double pause_s = first_start_pause_s;; pause_s = std::min(pause_s + 1, longest_start_pause_s)) {
    std::exception_ptr why;
    try {
      co_await connect_lidar();
    } catch (const LidarAbsent&) {
      why = std::current_exception();
    }
    if (!why) co_return;
    stop_if_aborted();
    const double left_s = longest_start_s - static_cast<double>(parts.clock.host_us() - begun_us) / 1e6;
    if (left_s <= 0)
      throw DeviceError(sentence(why) + " The rig waited " + fit::format_value(longest_start_s, 0) +
                        " s, as long as a lidar takes to start. Nothing was moved.");
    const std::string goes_on = fit::format_value(std::ceil(left_s), 0) + " s; Ctrl-C stops.";
    if (!said_why)
      note("warning", "waiting for the lidar: " + sentence(why) + " The rig keeps trying for " + goes_on);
    else
      note("info", "still waiting for the lidar, for another " + goes_on);
    said_why = true;
    co_await parts.clock.sleep(std::min(pause_s, left_s));
  }
}

awaitable<void> Runner::Impl::reconnect_lidar(std::exception_ptr why) {
  streaming = false;
  note("warning", "lidar lost: " + sentence(why) + " The rig is reconnecting.");
  co_await connect_again(why);
  ++state.reconnects;
  note("info", "lidar is back");
}

awaitable<void> Runner::Impl::connect_again(std::exception_ptr why) {
  double pause_s = 0.5;
  for (int attempt = 1; attempt <= connect_attempts; ++attempt, pause_s *= 2) {
    stop_if_aborted();
    co_await parts.clock.sleep(pause_s);
    try {
      co_await connect_lidar();
      why = nullptr;
    } catch (...) {
      why = std::current_exception();
    }
    if (!why) {
      // A device that was switched off counts from zero again.
      time.lidar_began_anew();
      co_return;
    }
  }
  stop_if_aborted();
  throw DeviceError("The lidar was lost and did not come back: " + sentence(why) +
                    " The stage has stopped, and what was captured is in " + session.path() +
                    ". Check the lidar's power and cable, then continue with rig resume.");
}

awaitable<void> Runner::Impl::compare_clocks() {
  constexpr int scans = 12;
  const LidarStream all = whole_scan(known_bench.lidar);
  std::uint64_t first_ms = 0, last_ms = 0;
  std::int64_t first_us = 0, last_us = 0;
  int failures = 0;
  for (int i = 0; i < scans; ++i) {
    const auto reconnects_before = state.reconnects;
    const lidar::Scan scan = co_await next_scan(all, nullptr, failures);
    if (state.reconnects != reconnects_before) i = 0;  // The pause in between says nothing of the clocks.
    last_ms = scan.device_ms;
    last_us = parts.clock.host_us();
    if (i == 1) first_ms = last_ms, first_us = last_us;
    show(scan);
  }
  co_await stop_stream();
  const double device_s = static_cast<double>(last_ms - first_ms) / 1e3;
  const double host_s = static_cast<double>(last_us - first_us) / 1e6;
  time.follow_lidar(parts.lidar.own_time() || host_s < 0.8 * device_s || host_s > 1.5 * device_s + 0.2);
  if (time.follows_lidar())
    note("info", "lidar and computer clocks are unrelated: the session runs on the lidar's time");
}

void Runner::Impl::record_lidar_statistics() {
  const json counted = parts.lidar.statistics();
  if (!counted.is_object()) return;
  session.set("lidar_statistics", counted.dump());
  const auto count = [&](const char* key) { return counted.value(key, std::int64_t{0}); };
  const auto troubles = count("lost") + count("damaged") + count("repeated") + count("reconnections") +
                        count("attempts_in_vain");
  note(troubles == 0 ? "info" : "warning",
       "lidar in this run: " + grouped(count("scans")) + " scans received; " + grouped(count("lost")) +
           " lost, " + grouped(count("damaged")) + " with checksum errors or wrong length, " +
           grouped(count("repeated")) + " repeated, " + grouped(count("stale")) + " of earlier requests; " +
           "reconnections: " + grouped(count("reconnections")) +
           ", failed connections: " + grouped(count("attempts_in_vain")));
}

void Runner::Impl::show(const lidar::Scan& scan) {
  if (!seen_ms || scan.device_ms > *seen_ms) seen_ms = scan.device_ms;
  constexpr std::size_t kept = 400;
  const int middle = (scan.first_step + scan.last_step) / 2;
  if (middle != state.beam_step || state.beam_mm.size() >= 2 * kept) {
    const auto end = state.beam_mm.end();
    if (middle == state.beam_step)
      state.beam_mm.erase(state.beam_mm.begin(), end - kept);
    else
      state.beam_mm.clear();
    state.beam_step = middle;
  }
  if (!scan.range_mm.empty()) state.beam_mm.push_back(scan.range_mm[scan.range_mm.size() / 2]);
  state.scan = scan;
  state.scan_seen = true;
}

}  // namespace rig
