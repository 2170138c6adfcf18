// SPDX-License-Identifier: MIT
// Pegasus Falcon rotator: degrees with two decimals from 0 to 360 on its own scale, whose ends it does not
// pass. It keeps its zero without power, has no home switch and no command for its speed.
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>

#include "rig/stage/stage_language.hpp"
#include "rig/stage/stage_reply.hpp"

namespace rig::stages {

namespace {

using boost::asio::awaitable;

constexpr int falcon_attempts = 3;
constexpr double units_per_deg = 100;
constexpr long long units_per_turn = 36000;

class FalconProtocol : public StageProtocol {
 public:
  FalconProtocol(SerialLink& link, const StageOptions& options) : link_(link), options_(options) {}

  awaitable<StageIdentity> identify() override;
  awaitable<StageReading> read() override;
  awaitable<void> set_speed(double, double) override { co_return; }
  [[nodiscard]] bool has_speed() const override { return false; }
  awaitable<void> start_homing() override { co_return; }
  awaitable<void> start_move(long long target) override;
  awaitable<void> start_turn(double speed) override;
  awaitable<void> start_stop() override;
  std::string stop_now() override;
  std::string stop_for_good() override { return "\nFH\n"; }

 private:
  awaitable<std::optional<std::string>> ask_once(std::string text, std::string beginning);
  awaitable<std::string> ask(std::string text, std::string beginning);
  awaitable<FalconStatus> status();
  void demand_not_stopped() const;

  SerialLink& link_;
  StageOptions options_;
  bool is_stop_requested_ = false;
  std::optional<double> target_;  ///< Of the motion that is not over yet.
};

/// The answer that begins so; nothing if none came.
awaitable<std::optional<std::string>> FalconProtocol::ask_once(std::string text, std::string beginning) {
  text += '\n';
  const auto due = co_await link_.ask(std::move(text), options_.reply_s);
  for (;;) {
    const std::optional<std::string> line = co_await link_.read_line(due);
    if (!line) break;
    if (line->starts_with(beginning)) co_return line;
  }
  link_.forget_answers();
  co_return std::nullopt;
}

awaitable<std::string> FalconProtocol::ask(std::string text, std::string beginning) {
  link_.listen_anew();
  for (int attempt = 0; attempt < falcon_attempts; ++attempt) {
    const std::optional<std::string> line = co_await ask_once(text, beginning);
    if (line) co_return *line;
  }
  throw link_.unanswered(text, falcon_attempts, "Check its power and its cable.");
}

awaitable<StageIdentity> FalconProtocol::identify() {
  const std::string beginning = "FV:";
  const std::string line = co_await ask("FV", beginning);
  StageIdentity identity;
  identity.language = "falcon";
  identity.model = options_.model.empty() ? "Pegasus Falcon" : options_.model;
  identity.firmware = line.substr(beginning.size());
  identity.units_per_deg = units_per_deg;
  co_return identity;
}

awaitable<FalconStatus> FalconProtocol::status() {
  for (int attempt = 0; attempt < falcon_attempts; ++attempt) {
    const std::string line = co_await ask("FA", "FR_OK:");
    if (const auto found = falcon_status(line)) co_return *found;
  }
  throw StageLost("the stage on " + link_.path() +
                  " answers `FA` with damaged lines. If it still turns, switch it off. Check its cable.");
}

/// There is no checksum: rest is believed when said twice, with the same position.
awaitable<StageReading> FalconProtocol::read() {
  FalconStatus now = co_await status();
  StageReading reading;
  reading.moving = now.moving;
  if (!now.moving) {
    const FalconStatus again = co_await status();
    reading.moving = again.moving || again.deg != now.deg;
    now = again;
  }
  reading.position = std::round(now.deg * units_per_deg);
  reading.homed = true;
  if (now.at_limit) reading.warnings.push_back("a limit switch stopped it");
  if (now.reversed)
    reading.warnings.push_back("its own sense of rotation is reversed: its angles are mirrored");
  if (!reading.moving) {
    const std::optional<double> target = std::exchange(target_, std::nullopt);
    if (target && reading.position != *target)
      reading.fault = now.at_limit ? "a limit switch was hit"
                                   : "it stopped short of its target without a reason (stalled, power "
                                     "interrupted, or stopped from elsewhere)";
  }
  co_return reading;
}

void FalconProtocol::demand_not_stopped() const {
  if (is_stop_requested_) throw StageError("the stage was stopped. Give the command again to continue.");
}

awaitable<void> FalconProtocol::start_move(long long target) {
  is_stop_requested_ = false;
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "MD:%.2f", static_cast<double>(target) / units_per_deg);
  const std::string command = text.data();
  if (target < 0 || target >= units_per_turn)
    throw StageRefusal(
        "the stage cannot do `" + command +
        "`: it turns from 0 to 359.99 deg of its own scale. Nothing was moved. Move the rig's zero on "
        "that scale with zero_deg in the bench file, or change the procedure.");
  for (int attempt = 0; attempt < falcon_attempts; ++attempt) {
    demand_not_stopped();
    const std::optional<std::string> echo = co_await ask_once(command, command);
    target_ = static_cast<double>(target);
    if (echo && *echo == command) co_return;
    const FalconStatus now = co_await status();
    if (now.moving || std::round(now.deg * units_per_deg) == *target_) co_return;
  }
  target_.reset();
  throw StageRefusal("the stage did not accept `" + command + "`, sent " + std::to_string(falcon_attempts) +
                     " times. Nothing was moved by it. Look at its own display or program for an error.");
}

awaitable<void> FalconProtocol::start_turn(double) {
  throw StageRefusal(
      "this stage cannot turn at a given rate: its language has no speed. Nothing was moved. Use a sweep "
      "instead.");
  co_return;
}

awaitable<void> FalconProtocol::start_stop() {
  is_stop_requested_ = false;
  link_.forget_answers();
  target_.reset();
  co_await ask("FH", "FH:1");
}

std::string FalconProtocol::stop_now() {
  is_stop_requested_ = true;
  return "\nFH\n";
}

}  // namespace

StageLanguage make_falcon() {
  StageLanguage language;
  language.names = {"falcon"};
  language.baud = 9600;
  language.zero_deg = 180;
  language.create = [](const std::string&, SerialLink& link,
                       const StageOptions& options) -> std::unique_ptr<StageProtocol> {
    return std::make_unique<FalconProtocol>(link, options);
  };
  return language;
}

}  // namespace rig::stages
