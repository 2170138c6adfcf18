// SPDX-License-Identifier: MIT
// Sigma-Koki/OptoSigma controllers, SHOT and GSC: docs/operate/stages.md. No ids and no checksums, so that
// nothing is believed that was not said twice; moves are queued and then started, so that a stop may come in
// between; the dialect `gsc` answers questions only, so that after each command its status tells whether it
// was understood. Neither knows whether it was homed: the driver remembers it, and forgets it when the count
// is not where it was left.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>

#include "rig/stage/stage_language.hpp"
#include "rig/stage/stage_reply.hpp"

namespace rig::stages {

namespace {

using boost::asio::awaitable;
using Clock = SerialLink::Clock;

constexpr int shot_attempts = 4;
constexpr double farthest = 16777214;                      ///< Pulses, in both dialects.
constexpr double usual_speed = 5000, usual_ramp_ms = 200;  ///< After power-on.
constexpr double usual_pulses_per_deg = 400;               ///< 144:1 worm, 0.72 deg motor, half steps.
constexpr double longest_ramp_ms = 1000;
/// For controllers that may not acknowledge; and once they were found not to.
constexpr auto acknowledgement_time = std::chrono::milliseconds(30),
               silent_time = std::chrono::milliseconds(3);
constexpr int commands_to_decide = 4;
constexpr int most_polls_at_rest = 500, polls_before_stop = 50;

enum class Activity { standing, homing, moving, turning, stopping };

class ShotProtocol : public StageProtocol {
 public:
  ShotProtocol(std::string dialect, SerialLink& link, const StageOptions& options)
      : dialect_(std::move(dialect)), link_(link), options_(options) {}

  awaitable<StageIdentity> identify() override;
  awaitable<StageReading> read() override;
  awaitable<void> set_speed(double speed, double acceleration) override;
  awaitable<void> start_homing() override;
  awaitable<void> start_move(long long target) override;
  awaitable<void> start_turn(double speed) override;
  awaitable<void> start_stop() override;
  std::string stop_now() override;
  std::string stop_for_good() override { return "\r\nL:E\r\n"; }
  void link_was_lost() override;

 private:
  [[nodiscard]] bool is_gsc() const { return dialect_ == "gsc"; }
  [[nodiscard]] std::string axis() const { return std::to_string(options_.axis); }
  awaitable<Clock::time_point> send(std::string text);
  awaitable<std::optional<std::string>> ask_text(std::string question);
  awaitable<ShotStatus> status();
  awaitable<std::optional<bool>> command(std::string text);
  awaitable<void> demand(std::string text);
  awaitable<ShotStatus> at_rest();
  awaitable<bool> has_begun(ShotStatus before);
  awaitable<void> drive_to(double target);
  awaitable<void> use_speed(double speed, double acceleration);
  void demand_not_stopped() const;
  void judge_rest(const ShotStatus& now, StageReading& reading);

  std::string dialect_;
  SerialLink& link_;
  StageOptions options_;
  bool is_stop_requested_ = false;  ///< A motion must not be started any more.
  int axes_ = 1;
  int silent_commands_ = 0;
  double speed_ = 0, acceleration_ = 0;
  bool has_turn_speed_ = false;
  bool homed_ = false;
  Activity doing_ = Activity::standing;
  double target_ = 0;
  std::optional<double> left_at_;  ///< Where it stood when last looked at.
};

[[noreturn]] void refuse(const std::string& text, const std::string& why) {
  throw StageRefusal("the stage refused `" + text + "`: " + why + ". Nothing was moved by it.");
}

// --- one question, one answer ---

/// Returns when the answer is due.
awaitable<Clock::time_point> ShotProtocol::send(std::string text) {
  text += "\r\n";
  return link_.ask(std::move(text), options_.reply_s);
}

awaitable<ShotStatus> ShotProtocol::status() {
  link_.listen_anew();
  for (int attempt = 0; attempt < shot_attempts; ++attempt) {
    const auto due = co_await send("Q:");
    for (bool is_waiting = true; is_waiting;) {
      const std::optional<std::string> line = co_await link_.read_line(due);
      is_waiting = line.has_value();
      const auto found = line ? shot_status(*line, options_.axis) : std::nullopt;
      if (found) co_return *found;
    }
    link_.forget_answers();
  }
  throw link_.unanswered(
      "Q:", shot_attempts,
      "Check its power, its cable (these controllers need the RTS and CTS wires), its baud rate "
      "and its axis (" +
          axis() + ").");
}

/// Nothing if it does not know the question. Without a checksum, a text is believed when it is said twice.
awaitable<std::optional<std::string>> ShotProtocol::ask_text(std::string question) {
  const auto is_printable = [](char c) { return c >= ' ' && c <= '~'; };
  std::optional<std::string> before;
  for (int attempt = 0, silences = 0; attempt < 2 * shot_attempts; ++attempt) {
    const auto due = co_await send(question);
    const std::optional<std::string> line = co_await link_.read_line(due);
    if (line && shot_acknowledgement(*line)) co_return std::nullopt;
    if (line && line == before) co_return line;
    if (line && std::ranges::all_of(*line, is_printable)) before = line;
    if (!line) {
      link_.forget_answers();
      if (++silences + 1 == shot_attempts) co_return std::nullopt;
    }
  }
  co_return std::nullopt;
}

/// Was it understood? Nothing if nobody knows.
awaitable<std::optional<bool>> ShotProtocol::command(std::string text) {
  auto due = co_await send(text);
  if (is_gsc())
    due = Clock::now() + (silent_commands_ < commands_to_decide ? acknowledgement_time : silent_time);
  for (bool is_waiting = true; is_waiting;) {
    const std::optional<std::string> line = co_await link_.read_line(due);
    is_waiting = line.has_value();
    const auto answer = line ? shot_acknowledgement(*line) : std::nullopt;
    if (answer) co_return answer;
  }
  ++silent_commands_;
  if (!is_gsc()) {
    link_.forget_answers();
    co_return std::nullopt;
  }
  const ShotStatus now = co_await status();
  co_return now.understood;
}

/// For commands that may be given twice.
awaitable<void> ShotProtocol::demand(std::string text) {
  link_.listen_anew();
  for (int attempt = 0; attempt < shot_attempts; ++attempt) {
    const std::optional<bool> understood = co_await command(text);
    if (understood && *understood) co_return;
    if (understood && attempt + 1 == shot_attempts)
      refuse(text, "it does not know this command or its values");
  }
  throw link_.unanswered(text, shot_attempts, "Check its power and cable.");
}

// --- who it is ---

awaitable<StageIdentity> ShotProtocol::identify() {
  const ShotStatus now = co_await status();
  axes_ = now.axes;
  StageIdentity identity;
  identity.language = dialect_;
  identity.units_per_deg = options_.units_per_deg > 0 ? options_.units_per_deg : usual_pulses_per_deg;
  if (!is_gsc()) {
    auto asking_name = ask_text("?:N");
    const std::optional<std::string> name = co_await std::move(asking_name);
    // Unasked for by name, a controller without one is taken for a GSC.
    if (!name && options_.language.empty()) throw StageError("the controller has no name: it is not a SHOT.");
    identity.model = name.value_or("SHOT");
  } else {
    identity.model = "GSC";
  }
  if (!options_.model.empty()) identity.model = options_.model;
  auto asking_version = ask_text("?:V");
  identity.firmware = (co_await std::move(asking_version)).value_or("");
  co_return identity;
}

// --- where it is ---

/// What an answer at rest means depends on what was going on.
void ShotProtocol::judge_rest(const ShotStatus& now, StageReading& reading) {
  const Activity was = std::exchange(doing_, Activity::standing);
  if (now.at_limit) reading.warnings.push_back("a limit switch stopped it");
  if (was == Activity::homing) homed_ = now.position == 0 && !now.at_limit;
  if (was == Activity::moving && now.position != target_) {
    reading.fault = now.at_limit ? "a limit switch was hit"
                                 : "it stopped short of its target without a reason (stalled, power "
                                   "interrupted, or stopped from elsewhere)";
    homed_ = homed_ && now.at_limit;
  }
  if (was == Activity::standing && left_at_ && now.position != *left_at_) {
    reading.warnings.push_back("its count changed at rest: its power was interrupted");
    homed_ = false;
  }
  left_at_ = now.position;
}

/// One flipped bit makes Ready of Busy: rest is believed when said twice, with the same position.
awaitable<StageReading> ShotProtocol::read() {
  ShotStatus now = co_await status();
  bool is_moving = now.busy;
  if (!is_moving) {
    const ShotStatus again = co_await status();
    is_moving = again.busy || again.position != now.position;
    now = again;
  }
  StageReading reading;
  reading.position = now.position;
  reading.moving = is_moving;
  if (!is_moving) judge_rest(now, reading);
  reading.homed = homed_;
  co_return reading;
}

/// It may have lost its power with its port, and would not say so.
void ShotProtocol::link_was_lost() {
  homed_ = false;
  left_at_.reset();
  doing_ = Activity::standing;
}

// --- motion ---

void ShotProtocol::demand_not_stopped() const {
  if (is_stop_requested_) throw StageError("the stage was stopped. Give the command again to continue.");
}

/// While it moves it takes no other motion: it is stopped first.
awaitable<ShotStatus> ShotProtocol::at_rest() {
  std::optional<ShotStatus> before;
  for (int poll = 0; poll < most_polls_at_rest; ++poll) {
    const ShotStatus now = co_await status();
    if (!now.busy && before && before->position == now.position) co_return now;
    if (now.busy && poll % polls_before_stop == 0) {
      co_await demand("L:" + axis());
    }
    before = now.busy ? std::nullopt : std::optional(now);
    if (!now.busy) continue;
    co_await link_.drain();
  }
  throw StageError("the stage does not come to rest, although it was ordered to stop. Switch it off.");
}

awaitable<bool> ShotProtocol::has_begun(ShotStatus before) {
  const ShotStatus now = co_await status();
  co_return now.busy || now.position != before.position;
}

awaitable<void> ShotProtocol::start_homing() {
  const std::string text = is_gsc() ? "H:" + axis() + "-" : "H:" + axis();
  homed_ = false;
  is_stop_requested_ = false;
  for (int attempt = 0; attempt < shot_attempts; ++attempt) {
    const ShotStatus before = co_await at_rest();
    demand_not_stopped();
    const std::optional<bool> understood = co_await command(text);
    // Without acknowledgement "understood" may be about the command before: then only motion proves it.
    const bool begun = co_await has_begun(before);
    if (begun || (understood && *understood && !is_gsc())) {
      doing_ = Activity::homing;
      co_return;
    }
    if (understood && !*understood && attempt + 1 == shot_attempts)
      refuse(text, "its motor is free, or it cannot be homed");
  }
  throw StageRefusal("the stage did not begin homing, commanded " + std::to_string(shot_attempts) +
                     " times. Nothing was moved. Check that its motor is connected and switched on.");
}

/// Queued first, then started. Whatever is lost on the way, the target stays the same: a relative move is
/// reckoned anew from where the stage stands.
awaitable<void> ShotProtocol::drive_to(double target) {
  for (int attempt = 0; attempt < shot_attempts; ++attempt) {
    const ShotStatus before = co_await at_rest();
    demand_not_stopped();
    if (before.position == target) co_return;
    const bool is_relative = is_gsc() && axes_ > 1;
    const double pulses = std::clamp(is_relative ? target - before.position : target, -farthest, farthest);
    const std::string text = (is_relative ? "M:" : "A:") + axis() + (pulses < 0 ? "-P" : "+P") +
                             std::to_string(std::llabs(std::llround(pulses)));
    const std::optional<bool> is_queued = co_await command(text);
    demand_not_stopped();
    if (is_queued && !*is_queued && attempt + 1 == shot_attempts)
      refuse(text, "its motor is free, or the target is out of its range");
    if (!is_queued || !*is_queued) continue;
    const std::optional<bool> is_started = co_await command("G:");
    if (is_started && *is_started && !is_gsc()) co_return;
    const bool begun = co_await has_begun(before);
    if (begun) co_return;
    if (is_started && !*is_started && attempt + 1 == shot_attempts) refuse("G:", "it gives no reason");
  }
  throw StageRefusal(
      "the stage did not begin to move, commanded " + std::to_string(shot_attempts) +
      " times. Nothing was moved. Check that its motor is connected and switched on (C:" + axis() + "1).");
}

awaitable<void> ShotProtocol::start_move(long long target) {
  if (std::llabs(target) > static_cast<long long>(farthest))
    refuse("A:" + axis(), "its counter ends at 16777214 pulses");
  is_stop_requested_ = false;
  if (std::exchange(has_turn_speed_, false)) {
    co_await use_speed(speed_, acceleration_);
  }
  co_await drive_to(static_cast<double>(target));
  target_ = static_cast<double>(target);
  doing_ = Activity::moving;
}

awaitable<void> ShotProtocol::start_turn(double speed) {
  is_stop_requested_ = false;
  has_turn_speed_ = true;
  co_await at_rest();
  co_await use_speed(std::abs(speed), acceleration_);
  auto driving = drive_to(speed < 0 ? -farthest : farthest);
  co_await std::move(driving);
  doing_ = Activity::turning;
}

awaitable<void> ShotProtocol::start_stop() {
  is_stop_requested_ = false;
  link_.forget_answers();
  const std::string text = doing_ == Activity::homing ? "L:E" : "L:" + axis();
  if (doing_ == Activity::homing) homed_ = false;
  doing_ = Activity::stopping;
  co_await demand(text);
  if (!is_gsc()) co_return;
  // A lost command looks like one that was understood; a stop is worth saying twice.
  co_await demand(text);
}

/// Homing heeds only L:E. The line end before it ends whatever was half said.
std::string ShotProtocol::stop_now() {
  is_stop_requested_ = true;
  return doing_ == Activity::homing ? "\r\nL:E\r\n" : "\r\nL:" + axis() + "\r\n";
}

// --- speed ---

awaitable<void> ShotProtocol::set_speed(double speed, double acceleration) {
  speed_ = speed;
  if (acceleration > 0) acceleration_ = acceleration;
  has_turn_speed_ = false;
  co_await use_speed(speed_, acceleration_);
}

/// Start and full speed in pulses per second and the time between them in milliseconds.
awaitable<void> ShotProtocol::use_speed(double speed, double acceleration) {
  const double most = is_gsc() ? 20000 : 500000;
  const double full = std::max(1.0, std::round(speed > 0 ? speed : usual_speed));
  if (full > most)
    refuse("D:" + axis(),
           "its fastest is " + std::to_string(std::llround(most)) + " pulses/s; lower speed_deg_s");
  const bool is_slow = is_gsc() && full <= 200;
  const double start = std::max(is_gsc() && !is_slow ? 50.0 : 1.0, std::min(500.0, std::floor(full / 10)));
  const double ramp_ms = acceleration > 0 ? 1000 * std::max(0.0, full - start) / acceleration : usual_ramp_ms;
  const std::string triplet = "S" + std::to_string(std::llround(std::min(start, full))) + "F" +
                              std::to_string(std::llround(full)) + "R" +
                              std::to_string(std::llround(std::clamp(ramp_ms, 0.0, longest_ramp_ms)));
  co_await at_rest();
  if (is_gsc() && axes_ == 2) {
    // The GSC-02 wants a range and both axes, later ones want an axis as the SHOT does.
    auto asking = command((is_slow ? "D:1" : "D:2") + triplet + triplet);
    const std::optional<bool> understood = co_await std::move(asking);
    if (understood && *understood) co_return;
  }
  co_await demand("D:" + axis() + triplet);
}

}  // namespace

StageLanguage make_shot() {
  StageLanguage language;
  language.names = {"shot", "gsc"};
  language.baud = 9600;
  language.hardware_flow_control = true;
  language.create = [](const std::string& dialect, SerialLink& link,
                       const StageOptions& options) -> std::unique_ptr<StageProtocol> {
    return std::make_unique<ShotProtocol>(dialect, link, options);
  };
  return language;
}

}  // namespace rig::stages
