// SPDX-License-Identifier: MIT
// Zaber ASCII v2 (firmware 6.06 and later): www.zaber.com/protocol-manual?protocol=ASCII. Every command
// carries an id and a checksum; answers are matched by address, axis and id, never by their order, because
// alerts interleave.
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "rig/stage/stage_language.hpp"
#include "rig/stage/stage_reply.hpp"

namespace rig::stages {

namespace {

using boost::asio::awaitable;
using Clock = SerialLink::Clock;

constexpr int stop_id = 99;  ///< Of the stop that waits for nobody; never used otherwise.
constexpr int highest_id = 98;
constexpr int zaber_attempts = 3;  ///< A spoilt command gets no answer: it is repeated.
/// maxspeed and accel count in units of 1/1.6384 microstep/s and 10^4/1.6384 microstep/s^2.
constexpr double speed_unit = 1.6384;

/// Microsteps in a turn, for stages whose firmware does not tell. X-RSW60A: 120:1 worm, 200 full steps, 64
/// microsteps.
const std::map<std::string, double> steps_per_turn{{"X-RSW60A", 1536000}, {"X-RSW60C", 384000}};

/// All warning flags, in words.
const std::map<std::string, std::string> flag_words{
    {"FF", "critical system error"},
    {"FN", "peripheral not supported"},
    {"FZ", "peripheral inactive"},
    {"FH", "hardware emergency stop"},
    {"FV", "overvoltage or undervoltage, driver off"},
    {"FO", "driver off by command"},
    {"FC", "current inrush error"},
    {"FM", "motor temperature error"},
    {"FD", "driver disabled: too hot or overloaded"},
    {"FQ", "encoder error"},
    {"FI", "index error"},
    {"FA", "analog encoder out of step"},
    {"FR", "overdrive limit exceeded"},
    {"FS", "stalled and stopped"},
    {"FB", "stream out of bounds"},
    {"FP", "interpolated path deviation"},
    {"FE", "limit error"},
    {"FT", "excessive twist"},
    {"WL", "unexpected limit switch"},
    {"WV", "supply voltage out of range"},
    {"WT", "controller too warm"},
    {"WS", "stalled and recovered"},
    {"WM", "displaced while standing"},
    {"WP", "calibration data problem"},
    {"WR", "no reference position"},
    {"WH", "not homed"},
    {"NC", "moved by its knob"},
    {"NI", "command interrupted"},
    {"ND", "stream discontinuity"},
    {"NR", "value rounded"},
    {"NT", "value truncated"},
    {"NU", "setting waits to be applied"},
    {"NJ", "joystick calibration"},
    {"NB", "firmware update mode"},
};

/// What can be refused, in words and what to do.
const std::map<std::string, std::string> rejections{
    {"BADDATA", "the value is out of its range"},
    {"BADCOMMAND", "it does not know this command"},
    {"BADAXIS", "it has no such axis"},
    {"DRIVERDISABLED", "its motor driver is off (too hot, overloaded or switched off)"},
    {"PARKED", "it is parked; unpark it first"},
    {"STATUSBUSY", "it is busy with something that cannot be interrupted"},
    {"AGAIN", "it is busy"},
    {"FULL", "its queue is full"},
    {"NOACCESS", "the command needs a higher access level"},
};

std::string in_words(const std::map<std::string, std::string>& words, const std::string& code) {
  const auto found = words.find(code);
  return found == words.end() ? code : found->second + " (" + code + ")";
}

class ZaberProtocol : public StageProtocol {
 public:
  ZaberProtocol(SerialLink& link, const StageOptions& options) : link_(link), options_(options) {}

  awaitable<StageIdentity> identify() override;
  awaitable<StageReading> read() override;
  awaitable<void> set_speed(double speed, double acceleration) override;
  awaitable<void> start_homing() override;
  awaitable<void> start_move(long long target) override;
  awaitable<void> start_turn(double speed) override;
  awaitable<void> start_stop() override;
  std::string stop_now() override { return command("stop", options_.axis, stop_id); }
  std::string stop_for_good() override { return "\n" + command("stop", options_.axis, stop_id); }

 private:
  [[nodiscard]] std::string command(const std::string& words, int axis, int id) const;
  awaitable<std::optional<ZaberReply>> ask_once(const std::string& words, int axis);
  awaitable<ZaberReply> ask(std::string words, int axis);
  awaitable<long long> get(std::string setting, int axis);
  awaitable<std::optional<std::string>> get_maybe(std::string setting, int axis);
  awaitable<std::vector<std::string>> flags(std::string highest);
  awaitable<double> find_units_per_deg();

  SerialLink& link_;
  StageOptions options_;
  int id_ = 0;
  long long usual_speed_ = 0;
};

// --- one question, one answer ---

std::string ZaberProtocol::command(const std::string& words, int axis, int id) const {
  return zaber_command(words, options_.address, axis, id);
}

awaitable<std::optional<ZaberReply>> ZaberProtocol::ask_once(const std::string& words, int axis) {
  id_ = id_ % highest_id + 1;
  const auto deadline = Clock::now() + std::chrono::duration_cast<Clock::duration>(
                                           std::chrono::duration<double>(options_.reply_s));
  std::string bytes = command(words, axis, id_);
  co_await link_.write(std::move(bytes), deadline);
  for (;;) {
    const std::optional<std::string> line = co_await link_.read_line(deadline);
    if (!line) co_return std::nullopt;
    if (auto reply = zaber_reply(*line, options_.address, axis, id_)) co_return reply;
  }
}

/// Repeats what got no answer: moves are absolute, so saying them twice does no harm.
awaitable<ZaberReply> ZaberProtocol::ask(std::string words, int axis) {
  link_.listen_anew();
  for (int attempt = 0; attempt < zaber_attempts; ++attempt) {
    const std::optional<ZaberReply> reply = co_await ask_once(words, axis);
    if (!reply || (!reply->accepted && (reply->data == "AGAIN" || reply->data == "STATUSBUSY") &&
                   attempt + 1 < zaber_attempts))
      continue;
    if (!reply->accepted)
      throw StageRefusal("the stage refused `" + words + "`: " + in_words(rejections, reply->data) +
                         (reply->flag == "--" ? "" : "; it also says: " + in_words(flag_words, reply->flag)) +
                         ". Nothing was moved by it.");
    co_return *reply;
  }
  throw link_.unanswered(
      words, zaber_attempts,
      "Check its power, its cable and its address (" + std::to_string(options_.address) + ").");
}

awaitable<long long> ZaberProtocol::get(std::string setting, int axis) {
  for (int attempt = 1;; ++attempt) {
    const ZaberReply reply = co_await ask("get " + setting, axis);
    const auto number = whole_number(reply.data.substr(0, reply.data.find(' ')));
    if (number) co_return *number;
    if (attempt == zaber_attempts)
      throw StageError("the stage answered `get " + setting + "` with '" + reply.data +
                       "' instead of a number. Check its cable, and that it is a Zaber with ASCII protocol.");
  }
}

awaitable<std::optional<std::string>> ZaberProtocol::get_maybe(std::string setting, int axis) {
  try {
    const ZaberReply reply = co_await ask("get " + setting, axis);
    co_return reply.data;
  } catch (const StageRefusal&) {
    co_return std::nullopt;
  }
}

// --- who it is ---

awaitable<double> ZaberProtocol::find_units_per_deg() {
  if (options_.units_per_deg > 0) co_return options_.units_per_deg;
  if (const auto found = steps_per_turn.find(options_.model); found != steps_per_turn.end())
    co_return found->second / 360;
  const std::optional<std::string> cycle = co_await get_maybe("limit.cycle.dist", options_.axis);
  const auto per_turn = cycle ? whole_number(*cycle) : std::nullopt;
  if (per_turn && *per_turn > 0) co_return static_cast<double>(*per_turn) / 360;
  throw StageRefusal(
      "the stage does not say how many microsteps make a turn. Nothing was moved. Write `model` (X-RSW60A "
      "...) or "
      "`units_per_deg` into the stage of the bench file.");
}

awaitable<StageIdentity> ZaberProtocol::identify() {
  StageIdentity identity;
  identity.language = "zaber";
  const long long device = co_await get("deviceid", 0);
  identity.model = options_.model.empty() ? "Zaber device " + std::to_string(device) : options_.model;
  identity.serial = (co_await get_maybe("system.serial", 0)).value_or("");
  identity.firmware = (co_await get_maybe("version", 0)).value_or("");
  const long long axes = co_await get("system.axiscount", 0);
  if (options_.axis > axes)
    throw StageRefusal("the stage's controller has " + std::to_string(axes) +
                       " axis(es), but the bench file names axis " + std::to_string(options_.axis) +
                       ". Nothing was moved. Correct `axis` there.");
  identity.units_per_deg = co_await find_units_per_deg();
  if (usual_speed_ == 0) usual_speed_ = co_await get("maxspeed", options_.axis);
  co_return identity;
}

// --- where it is ---

/// A reply shows the highest flag only; those below it are asked for.
awaitable<std::vector<std::string>> ZaberProtocol::flags(std::string highest) {
  if (highest == "--") co_return std::vector<std::string>();
  const ZaberReply reply = co_await ask("warnings", options_.axis);
  std::vector<std::string> all;
  for (const std::string& word : words_of(reply.data))
    if (word.size() == 2 && !whole_number(word) && word != "--") all.push_back(word);
  if (all.empty()) all.push_back(highest);
  co_return all;
}

awaitable<StageReading> ZaberProtocol::read() {
  ZaberReply reply;
  std::optional<long long> position;
  for (int attempt = 1; !position; ++attempt) {
    reply = co_await ask("get pos", options_.axis);
    position = whole_number(reply.data.substr(0, reply.data.find(' ')));
    if (!position && attempt == zaber_attempts)
      throw StageError("the stage answered `get pos` with '" + reply.data +
                       "' instead of a number. Check its cable.");
  }
  StageReading reading;
  reading.position = static_cast<double>(*position);
  reading.moving = reply.busy;
  reading.homed = true;
  const std::vector<std::string> all = co_await flags(reply.flag);
  for (const std::string& flag : all) {
    if (flag == "WR" || flag == "WH") reading.homed = false;
    if (flag[0] == 'F' && reading.fault.empty())
      reading.fault = in_words(flag_words, flag);
    else
      reading.warnings.push_back(in_words(flag_words, flag));
  }
  co_return reading;
}

// --- motion ---

awaitable<void> ZaberProtocol::set_speed(double speed, double acceleration) {
  const long long value = speed > 0 ? std::max(1LL, std::llround(speed * speed_unit)) : usual_speed_;
  co_await ask("set maxspeed " + std::to_string(value), options_.axis);
  if (acceleration > 0) {
    const long long steps = std::max(1LL, std::llround(acceleration * speed_unit / 1e4));
    co_await ask("set accel " + std::to_string(steps), options_.axis);
  }
}

awaitable<void> ZaberProtocol::start_homing() { co_await ask("home", options_.axis); }

awaitable<void> ZaberProtocol::start_move(long long target) {
  co_await ask("move abs " + std::to_string(target), options_.axis);
}

awaitable<void> ZaberProtocol::start_turn(double speed) {
  co_await ask("move vel " + std::to_string(std::llround(speed * speed_unit)), options_.axis);
}

awaitable<void> ZaberProtocol::start_stop() { co_await ask("stop", options_.axis); }

}  // namespace

StageLanguage make_zaber() {
  StageLanguage language;
  language.names = {"zaber"};
  language.baud = 115200;
  language.create = [](const std::string&, SerialLink& link,
                       const StageOptions& options) -> std::unique_ptr<StageProtocol> {
    return std::make_unique<ZaberProtocol>(link, options);
  };
  return language;
}

}  // namespace rig::stages
