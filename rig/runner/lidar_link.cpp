// SPDX-License-Identifier: MIT
#include "rig/runner/lidar_link.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "fit/numeric/number_format.hpp"
#include "rig/runner/device_lock.hpp"
#include "rig/runner/failures.hpp"
#include "rig/runner/lidar_doubts.hpp"
#include "rig/session/standing.hpp"
#include "rig/text_lines.hpp"

namespace rig {

using boost::asio::awaitable;
using nlohmann::json;

namespace {

constexpr int failures_without_scan = 3;  // A lidar that reconnects and never measures is lost.

/// Between two messages of the same loss; the session has all of them.
constexpr double between_like_losses_s = 60;
/// A lidar that is switched on with its network switch takes longer than one alone, which is back after 3 s.
constexpr double longest_wait_s = 30, longest_pause_s = 5;
constexpr double first_start_pause_s = 1, first_pause_s = 0.5;

double seconds_since(std::int64_t begun_us, const RunClock& clock) {
  return static_cast<double>(clock.host_us() - begun_us) / 1e6;
}

}  // namespace

LidarLink::LidarLink(RunnerParts& parts, const fit::Bench& bench, SessionStore& session, SessionClock& time,
                     const PlacedBench& placed, RunStatus& status, const RunControl& control)
    : parts_(parts),
      lidar_(parts.lidar),
      bench_(bench),
      session_(session),
      time_(time),
      placed_(placed),
      status_(status),
      control_(control) {}

awaitable<void> LidarLink::start(LidarStream stream) {
  co_await lidar_.start(stream);
  streaming_ = true;
  if (stream.intensity && !lidar_.sends_intensities() && !std::exchange(intensities_missed_, true))
    status_.note(
        "warning",
        "this lidar sends no intensities (it does not know the command ME): distances alone are stored");
}

awaitable<void> LidarLink::start_to_watch(LidarStream stream) {
  streaming_ = true;
  co_await lidar_.start(stream);
}

awaitable<void> LidarLink::end() {
  if (!streaming_) co_return;
  streaming_ = false;
  co_await lidar_.stop();
}

awaitable<void> LidarLink::stop() {
  std::exception_ptr why;
  try {
    co_await end();
  } catch (...) {
    why = std::current_exception();
  }
  if (!why) co_return;
  control_.stop_if_aborted();
  co_await reconnect(why);
}

awaitable<lidar::Scan> LidarLink::next(LidarStream stream, ScanGate* gate, int& failures) {
  for (;;) {
    control_.stop_if_aborted();
    std::exception_ptr why;
    lidar::Scan scan;
    try {
      if (!streaming_) {
        if (gate) gate->restart(seen_ms_);
        co_await start(stream);
      }
      scan = co_await lidar_.next();
    } catch (...) {
      why = std::current_exception();
    }
    if (!why) {
      report_clock_restart(scan);
      co_return scan;
    }
    control_.stop_if_aborted();
    if (is_a<UsageError>(why) || ++failures > failures_without_scan) std::rethrow_exception(why);
    co_await reconnect(why);
  }
}

void LidarLink::report_clock_restart(const lidar::Scan& scan) {
  const bool asked_for = std::exchange(power_cycle_announced_, false);
  if (lidar_.clock_restarts() == clock_restarts_) return;
  clock_restarts_ = lidar_.clock_restarts();
  json all = json::parse(session_.get("lidar_restarts").value_or("[]"), nullptr, false);
  if (!all.is_array()) all = json::array();
  all.push_back({{"host_us", time_.place_us(scan)}, {"device_ms", scan.device_ms}});
  session_.set("lidar_restarts", all.dump());
  const std::string goes_on =
      "the lidar's clock started again: time stamps (device_ms) of later scans have a new time base, "
      "continued by this computer's clock";
  if (asked_for) return status_.note("info", goes_on);
  status_.note(
      "warning",
      goes_on +
          ". The lidar restarted or its power was cut: if it was off for long it has cooled, and its "
          "warm-up is not repeated automatically" +
          (placed_.power_on_us() ? "; captures still count the time since power-on from before" : "") +
          ". Check its power supply.");
}

void LidarLink::judge(const json& identity) {
  std::string differs, doubtful, remedies;
  bool is_ill = false;
  for (const LidarDoubt& doubt : doubts_of_lidar(identity, bench_)) {
    if (doubt.weight == LidarDoubt::Weight::note) continue;
    const bool refused = doubt.weight == LidarDoubt::Weight::refusal, of_health = doubt.what == lidar_state;
    // The session has its lidar: its serial number is what counts.
    if (!refused && !of_health && session_.get("lidar")) continue;
    std::string& text = refused ? differs : doubtful;
    text += (text.empty() ? "" : ", ") + doubt.says;
    is_ill |= of_health;
    if (!refused) remedies += " " + doubt.remedy;
  }
  const std::string who = "the lidar" + (lidar_.address().empty() ? "" : " at " + lidar_.address());
  if (!differs.empty())
    throw UsageError("The bench file describes a lidar other than " + who + ": " + differs +
                     ". Correct 'lidar' in the bench file, or connect the lidar that it describes.");
  if (doubtful.empty() || doubtful == accepted_) return;
  if (!parts_.accepts_lidar) {
    const std::string why =
        "About " + who + ": " + doubtful + "." + remedies +
        " To measure with it all the same, give --accept-lidar; the session then says so.";
    if (is_ill) throw DeviceError(why);
    throw UsageError(why);
  }
  accepted_ = doubtful;
  session_.set("lidar_accepted", doubtful);
  status_.note("warning", "measured by the operator's decision (--accept-lidar) despite this about " + who +
                              ": " + doubtful);
}

awaitable<void> LidarLink::connect() {
  const json identity = co_await lidar_.connect();
  judge(identity);
  if (parts_.locks) parts_.locks->lock_lidar(identity);
  simulated_ = says_simulated(identity.dump());
  connected_ = true;
  seen_ms_.reset();
  const auto before = session_.get("lidar");
  if (!before) {
    session_.set("lidar", identity.dump());
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

awaitable<void> LidarLink::await_first() {
  const std::int64_t begun_us = parts_.clock.host_us();
  bool said_why = false;
  for (double pause_s = first_start_pause_s;; pause_s = std::min(pause_s + 1, longest_pause_s)) {
    std::exception_ptr why;
    try {
      co_await connect();
    } catch (const LidarAbsent&) {
      why = std::current_exception();
    }
    if (!why) co_return;
    control_.stop_if_aborted();
    const double left_s = longest_wait_s - seconds_since(begun_us, parts_.clock);
    if (left_s <= 0)
      throw DeviceError(sentence(why) + " The rig waited " + fit::format_value(longest_wait_s, 0) +
                        " s, as long as a lidar takes to start. Nothing was moved.");
    const std::string goes_on = fit::format_value(std::ceil(left_s), 0) + " s; Ctrl-C stops.";
    if (!said_why)
      status_.note("warning",
                   "waiting for the lidar: " + sentence(why) + " The rig keeps trying for " + goes_on);
    else
      status_.note("info", "still waiting for the lidar, for another " + goes_on);
    said_why = true;
    co_await parts_.clock.sleep(std::min(pause_s, left_s));
  }
}

awaitable<void> LidarLink::reconnect(std::exception_ptr why) {
  streaming_ = false;
  const std::string words = "lidar lost: " + sentence(why) + " The rig is reconnecting.";
  const auto [known, is_new] = losses_.try_emplace(words);
  Loss& loss = known->second;
  const bool was_said = !is_new && seconds_since(loss.reported_us, parts_.clock) < between_like_losses_s;
  if (was_said) {
    ++loss.unreported;
    session_.add_event(time_.now_us(), "warning", words);
  } else {
    status_.note("warning",
                 words + (loss.unreported > 0 ? " The same happened " + std::to_string(loss.unreported) +
                                                    " times more since it was last said."
                                              : ""));
    loss = {parts_.clock.host_us(), 0};
  }
  co_await connect_again(why);
  ++status_.state().reconnects;
  if (was_said)
    session_.add_event(time_.now_us(), "info", "lidar is back");
  else
    status_.note("info", "lidar is back");
}

awaitable<void> LidarLink::connect_again(std::exception_ptr why) {
  const std::int64_t begun_us = parts_.clock.host_us();
  for (double pause_s = first_pause_s, waited_s = 0; waited_s < longest_wait_s;
       pause_s = std::min(2 * pause_s, longest_pause_s)) {
    control_.stop_if_aborted();
    co_await parts_.clock.sleep(pause_s);
    try {
      co_await connect();
      why = nullptr;
    } catch (...) {
      why = std::current_exception();
    }
    if (!why) {
      // A device that was switched off counts from zero again.
      time_.lidar_began_anew();
      co_return;
    }
    waited_s = seconds_since(begun_us, parts_.clock);
  }
  control_.stop_if_aborted();
  throw DeviceError("The lidar was lost and did not come back within " +
                    fit::format_value(longest_wait_s, 0) + " s: " + sentence(why) +
                    " Check the lidar's power and cable.");
}

awaitable<void> LidarLink::reconnect_after_power_cycle() {
  streaming_ = false;
  power_cycle_announced_ = true;
  status_.note("info", "the lidar was switched off and on: the rig is reconnecting");
  co_await connect_again(nullptr);
}

awaitable<void> LidarLink::reconnect_once() {
  co_await connect();
  ++status_.state().reconnects;
  time_.lidar_began_anew();
  status_.note("info", "lidar is back");
}

std::string LidarLink::unfit_scans(const CaptureRequest& request) {
  return "The lidar sends scans that do not belong to the capture (steps other than " +
         std::to_string(request.first_step) + " to " + std::to_string(request.last_step) +
         ", or time stamps that do not advance). None was stored. Switch it off and on.";
}

awaitable<void> LidarLink::reconnect_for_unfit_scans(const CaptureRequest& request, int& failures) {
  if (++failures > failures_without_scan) throw DeviceError(unfit_scans(request));
  co_await reconnect(std::make_exception_ptr(
      DeviceError("its scans are of other steps, or their time stamps do not advance")));
}

awaitable<void> LidarLink::compare_clocks() {
  constexpr int scans = 12;
  const LidarStream all = whole_scan(bench_.lidar);
  std::uint64_t first_ms = 0, last_ms = 0;
  std::int64_t first_us = 0, last_us = 0;
  int failures = 0;
  for (int i = 0; i < scans; ++i) {
    const auto reconnects_before = status_.state().reconnects;
    const lidar::Scan scan = co_await next(all, nullptr, failures);
    if (status_.state().reconnects != reconnects_before)
      i = 0;  // The pause in between says nothing of the clocks.
    last_ms = scan.device_ms;
    last_us = parts_.clock.host_us();
    if (i == 1) first_ms = last_ms, first_us = last_us;
    show(scan);
  }
  co_await stop();
  const double device_s = static_cast<double>(last_ms - first_ms) / 1e3;
  const double host_s = static_cast<double>(last_us - first_us) / 1e6;
  time_.follow_lidar(lidar_.own_time() || host_s < 0.8 * device_s || host_s > 1.5 * device_s + 0.2);
  if (time_.follows_lidar())
    status_.note("info", "lidar and computer clocks are unrelated: the session runs on the lidar's time");
}

void LidarLink::record_statistics() {
  const json counted = lidar_.statistics();
  if (!counted.is_object()) return;
  session_.set("lidar_statistics", counted.dump());
  const auto count = [&](const char* key) { return counted.value(key, std::int64_t{0}); };
  const auto troubles = count("lost") + count("damaged") + count("repeated") + count("reconnections") +
                        count("attempts_in_vain");
  status_.note(troubles == 0 ? "info" : "warning",
               "lidar in this run: " + grouped(count("scans")) + " scans received; " +
                   grouped(count("lost")) + " lost, " + grouped(count("damaged")) +
                   " with checksum errors or wrong length, " + grouped(count("repeated")) + " repeated, " +
                   grouped(count("stale")) + " of earlier requests; " +
                   "reconnections: " + grouped(count("reconnections")) +
                   ", failed connections: " + grouped(count("attempts_in_vain")));
}

void LidarLink::show(const lidar::Scan& scan) {
  if (!seen_ms_ || scan.device_ms > *seen_ms_) seen_ms_ = scan.device_ms;
  status_.show(scan);
}

}  // namespace rig
