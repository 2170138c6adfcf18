// SPDX-License-Identifier: MIT
// The device side of Zaber ASCII version 2, as strict clients expect it:
// www.zaber.com/articles/ascii-protocol and www.zaber.com/wiki/ASCII. Written without regard to our own
// driver.
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "sim/stage_device.hpp"

namespace sim::stages {
StageLanguage make_zaber();
namespace {

constexpr std::size_t longest_command = 4096;  ///< All packets of one command together.
constexpr double speed_unit = 1.6384;  ///< maxspeed = microsteps/s times this; accel likewise / 10000.

std::optional<long long> whole_number(std::string_view text) {
  long long value = 0;
  const auto [end, failed] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (failed != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

std::vector<std::string> words_of(std::string_view text) {
  std::vector<std::string> words;
  std::size_t at = 0;
  while ((at = text.find_first_not_of(' ', at)) != std::string_view::npos) {
    const std::size_t end = std::min(text.find(' ', at), text.size());
    words.emplace_back(text.substr(at, end - at));
    at = end;
  }
  return words;
}

std::string two_digits(int number) {
  std::array<char, 16> text{};
  std::snprintf(text.data(), text.size(), "%02d", number);
  return text.data();
}

std::string checksum_of(std::string_view text) {
  unsigned sum = 0;
  for (const char c : text) sum += static_cast<unsigned char>(c);
  std::array<char, 8> hex{};
  std::snprintf(hex.data(), hex.size(), "%02X", (256 - sum % 256) % 256);
  return hex.data();
}

/// One command as addressed: numbers are optional from the left.
struct Command {
  int device = 0, axis = 0;
  std::optional<int> id;
  std::vector<std::string> words;
};

class ZaberStage : public StageDevice {
 public:
  explicit ZaberStage(const StageDeviceOptions& options)
      : mechanics_(options.physics), address_(options.address) {
    reset_settings();
    if (options.homed) mechanics_.home(-1e9);
  }

  std::string receive(std::string_view bytes, double now_s) override;
  std::string poll(double now_s) override;
  StageMechanics& mechanics() override { return mechanics_; }
  void inject(StageFault fault, double now_s) override;
  [[nodiscard]] int baud() const override { return 115200; }

 private:
  struct Answer {
    bool accepted = true;
    std::string data = "0";
  };

  std::string line(std::string_view text, double now_s);
  std::string execute(const Command& command, double now_s);
  Answer answer(const Command& command, double now_s);
  Answer get(const std::string& setting, int axis, double now_s);
  Answer set(const Command& command);
  Answer move(const std::vector<std::string>& words, double now_s);
  Answer warnings(const std::vector<std::string>& words, double now_s);
  bool start_move(double now_s, double target);
  [[nodiscard]] std::string reply(const Command& command, const Answer& answer, double now_s) const;
  [[nodiscard]] std::string framed(std::string text) const;
  /// The flags that hold now, highest priority first.
  [[nodiscard]] std::vector<std::string> flags(double now_s) const;
  [[nodiscard]] std::string highest_flag(double now_s) const;
  [[nodiscard]] bool busy(double now_s) const { return mechanics_.moving(now_s); }
  void interrupted_by(double now_s);
  void reset_settings();

  StageMechanics mechanics_;
  int address_;
  std::map<std::string, long long> axis_settings_, device_settings_;
  std::string pending_;  ///< The line being typed.
  bool pending_spoilt_ = false;
  std::string packets_;  ///< A command whose last packet ended with a backslash.
  bool stalled_ = false, limit_hit_ = false, noted_interruption_ = false, reject_next_ = false, dead_ = false;
  bool was_busy_ = false;
  int storm_ = 0;
};

void ZaberStage::reset_settings() {
  const StagePhysics& physics = mechanics_.physics();
  const double speed = physics.speed_deg_s * physics.units_per_deg;
  const double acceleration = physics.acceleration_deg_s2 * physics.units_per_deg;
  axis_settings_ = {
      {"maxspeed", std::llround(speed * speed_unit)},
      {"accel", std::llround(acceleration * speed_unit / 1e4)},
      {"limit.approach.maxspeed",
       std::llround(physics.homing_speed_deg_s * physics.units_per_deg * speed_unit)},
      {"resolution", 64},
      {"limit.cycle.dist", std::llround(physics.units_per_deg * 360)},
      {"peripheralid", 0},
      {"peripheral.serial", 0},
      {"knob.enable", 1},
  };
  device_settings_ = {{"deviceid", 50000},        {"system.serial", 100001}, {"device.hw.modified", 0},
                      {"system.axiscount", 1},    {"comm.alert", 0},         {"comm.checksum", 0},
                      {"comm.address", address_}, {"system.led.enable", 1},  {"comm.rs232.baud", 115200}};
}

// --- bytes to lines ---

std::string ZaberStage::receive(std::string_view bytes, double now_s) {
  if (dead_) return "";
  std::string out;
  for (const char c : bytes) {
    if (c == '\r' || c == '\n') {
      if (!pending_spoilt_) out += line(pending_, now_s);
      pending_.clear();
      pending_spoilt_ = false;
    } else if (c == '\b' || c == 0x7f) {
      if (!pending_.empty()) pending_.pop_back();
    } else if (c < 0x20 || c > 0x7e || pending_.size() >= longest_command) {
      pending_spoilt_ = true;  // The documented behaviour on noise: the command is discarded.
    } else {
      pending_ += c;
    }
  }
  return out;
}

std::string ZaberStage::line(std::string_view text, double now_s) {
  const std::size_t slash = text.find('/');
  if (slash == std::string_view::npos) return "";
  text.remove_prefix(slash + 1);
  if (text.size() >= 3 && text[text.size() - 3] == ':') {
    const std::string_view given = text.substr(text.size() - 2);
    text.remove_suffix(3);
    if (checksum_of(text) != given) return "";
  }
  Command command;
  command.words = words_of(text);
  std::vector<int> numbers;
  while (numbers.size() < 3 && !command.words.empty()) {
    const auto number = whole_number(command.words.front());
    if (!number || *number < 0 || *number > 99) break;
    numbers.push_back(static_cast<int>(*number));
    command.words.erase(command.words.begin());
  }
  if (!numbers.empty()) command.device = numbers[0];
  if (numbers.size() > 1) command.axis = numbers[1];
  if (numbers.size() > 2) command.id = numbers[2];
  if (command.device != 0 && command.device != address_) return "";

  // A command longer than a packet: "move abs \" and "cont 1 1000".
  const bool continued = !command.words.empty() && command.words.back() == "\\";
  if (continued) command.words.pop_back();
  if (command.words.size() >= 2 && command.words[0] == "cont") {
    std::vector<std::string> whole = words_of(packets_);
    whole.insert(whole.end(), command.words.begin() + 2, command.words.end());
    command.words = whole;
  }
  packets_.clear();
  if (continued) {
    for (const std::string& word : command.words) packets_ += word + " ";
    if (packets_.size() > longest_command) packets_.clear();
    return "";
  }
  return execute(command, now_s);
}

// --- lines to answers ---

std::string ZaberStage::framed(std::string text) const {
  if (device_settings_.at("comm.checksum") == 1) text += ":" + checksum_of(std::string_view(text).substr(1));
  return text + "\r\n";
}

std::string ZaberStage::reply(const Command& command, const Answer& answer, double now_s) const {
  std::string text = "@" + two_digits(address_) + " " + std::to_string(command.axis) + " ";
  if (command.id) text += two_digits(*command.id) + " ";
  text += answer.accepted ? "OK " : "RJ ";
  text += busy(now_s) ? "BUSY " : "IDLE ";
  return framed(text + highest_flag(now_s) + " " + answer.data);
}

std::string ZaberStage::execute(const Command& command, double now_s) {
  if (command.axis > 1) return reply(command, {false, "BADAXIS"}, now_s);
  const bool lists_warnings = !command.words.empty() && command.words[0] == "warnings";
  const Answer result = answer(command, now_s);
  const std::string out = reply(command, result, now_s);
  // A note is shown once, in the first reply after what it notes.
  if (!lists_warnings && !(command.words.size() == 1 && command.words[0] == "stop"))
    noted_interruption_ = false;
  return out;
}

ZaberStage::Answer ZaberStage::answer(const Command& command, double now_s) {
  const auto& words = command.words;
  if (words.empty()) return {};
  const std::string& verb = words[0];
  if (verb == "get" && words.size() == 2) return get(words[1], command.axis, now_s);
  if (verb == "set" && words.size() == 3) return set(command);
  if (verb == "warnings") return warnings(words, now_s);
  if (verb == "storage") return {false, "BADDATA"};
  if (verb == "system" && words.size() == 2 && words[1] == "reset") {
    mechanics_.power_cycle(now_s);
    stalled_ = limit_hit_ = false;
    return {};
  }
  if (verb == "stop" && words.size() == 1) {
    interrupted_by(now_s);
    mechanics_.stop(now_s);
    return {};
  }
  if (verb == "estop" && words.size() == 1) {
    interrupted_by(now_s);
    mechanics_.halt(now_s);
    return {};
  }
  if (verb == "home" || verb == "move") {
    if (std::exchange(reject_next_, false)) return {false, "DRIVERDISABLED"};
    stalled_ = limit_hit_ = false;
    if (verb == "move") return move(words, now_s);
    if (words.size() != 1) return {false, "BADCOMMAND"};
    interrupted_by(now_s);
    mechanics_.home(now_s);
    was_busy_ = true;
    return {};
  }
  return {false, "BADCOMMAND"};
}

ZaberStage::Answer ZaberStage::get(const std::string& setting, int axis, double now_s) {
  if (setting == "pos") return {true, std::to_string(std::llround(mechanics_.position_units(now_s)))};
  if (setting == "version") return {true, "7.28"};
  if (setting == "version.build") return {true, "13870"};
  if (setting == "system.voltage") return {true, "47.9"};
  if (setting == "system.temperature") return {true, "33.5"};
  if (setting == "limit.min") return {true, std::to_string(std::llround(mechanics_.min_units(now_s)))};
  if (setting == "limit.max") return {true, std::to_string(std::llround(mechanics_.max_units(now_s)))};
  if (setting == "limit.home.pos") return {true, "0"};
  if (setting == "limit.home.triggered") return {true, mechanics_.homed(now_s) ? "1" : "0"};
  if (const auto found = axis_settings_.find(setting); found != axis_settings_.end())
    return {true, std::to_string(found->second)};
  if (const auto found = device_settings_.find(setting); axis == 0 && found != device_settings_.end())
    return {true, std::to_string(found->second)};
  return {false, "BADCOMMAND"};
}

ZaberStage::Answer ZaberStage::set(const Command& command) {
  const std::string& setting = command.words[1];
  const auto value = whole_number(command.words[2]);
  if (setting == "maxspeed" || setting == "accel" || setting == "limit.approach.maxspeed") {
    if (!value || *value <= 0 || *value > 1'000'000'000) return {false, "BADDATA"};
    axis_settings_[setting] = *value;
    const auto units = static_cast<double>(*value) / speed_unit;
    if (setting == "maxspeed") mechanics_.set_speed(units);
    if (setting == "accel") mechanics_.set_acceleration(units * 1e4);
    return {};
  }
  if (setting == "comm.alert" || setting == "comm.checksum" || setting == "system.led.enable" ||
      setting == "knob.enable") {
    if (!value || *value < 0 || *value > 1) return {false, "BADDATA"};
    (setting == "knob.enable" ? axis_settings_ : device_settings_)[setting] = *value;
    return {};
  }
  return {false, "BADCOMMAND"};
}

bool ZaberStage::start_move(double now_s, double target) {
  if (target < mechanics_.min_units(now_s) || target > mechanics_.max_units(now_s)) return false;
  interrupted_by(now_s);
  mechanics_.move_to(now_s, target);
  was_busy_ = true;
  return true;
}

ZaberStage::Answer ZaberStage::move(const std::vector<std::string>& words, double now_s) {
  if (words.size() < 2) return {false, "BADCOMMAND"};
  const std::string& how = words[1];
  if (how == "min" || how == "max") {
    if (words.size() != 2) return {false, "BADCOMMAND"};
    start_move(now_s, std::round(how == "min" ? mechanics_.min_units(now_s) : mechanics_.max_units(now_s)));
    return {};
  }
  if ((how != "abs" && how != "rel" && how != "vel") || words.size() != 3) return {false, "BADCOMMAND"};
  const auto value = whole_number(words[2]);
  if (!value || std::llabs(*value) > 2'000'000'000) return {false, "BADDATA"};
  const auto number = static_cast<double>(*value);
  if (how == "vel") {
    interrupted_by(now_s);
    mechanics_.turn(now_s, number / speed_unit);
    was_busy_ = true;
    return {};
  }
  const double from = how == "rel" ? std::round(mechanics_.position_units(now_s)) : 0;
  return start_move(now_s, from + number) ? Answer{} : Answer{false, "BADDATA"};
}

void ZaberStage::interrupted_by(double now_s) {
  if (busy(now_s)) noted_interruption_ = true;
}

std::vector<std::string> ZaberStage::flags(double now_s) const {
  std::vector<std::string> flags;
  if (stalled_) flags.push_back("FS");
  if (limit_hit_) flags.push_back("WL");
  if (!mechanics_.homed(now_s)) flags.push_back("WR");
  if (noted_interruption_) flags.push_back("NI");
  return flags;
}

std::string ZaberStage::highest_flag(double now_s) const {
  const auto all = flags(now_s);
  return all.empty() ? "--" : all.front();
}

ZaberStage::Answer ZaberStage::warnings(const std::vector<std::string>& words, double now_s) {
  if (words.size() > 2 || (words.size() == 2 && words[1] != "clear")) return {false, "BADCOMMAND"};
  const auto all = flags(now_s);
  std::string list = two_digits(static_cast<int>(all.size()));
  for (const std::string& flag : all) list += " " + flag;
  if (words.size() == 2) stalled_ = limit_hit_ = noted_interruption_ = false;
  return {true, list};
}

// --- what it says unasked, and what goes wrong ---

std::string ZaberStage::poll(double now_s) {
  std::string out;
  const bool alerts = device_settings_.at("comm.alert") == 1;
  // A limit met while turning without end stops the motion.
  const double position = mechanics_.position_units(now_s);
  if (busy(now_s) && !mechanics_.homing(now_s) &&
      (position > mechanics_.max_units(now_s) || position < mechanics_.min_units(now_s))) {
    mechanics_.halt(now_s);
    limit_hit_ = true;
  }
  const bool ended = was_busy_ && !busy(now_s);
  was_busy_ = busy(now_s);
  if (dead_) return "";
  if (ended && alerts) out += framed("!" + two_digits(address_) + " 1 IDLE " + highest_flag(now_s));
  for (; storm_ > 0; --storm_)
    out +=
        framed("!" + two_digits(address_) + " 1 " + (busy(now_s) ? "BUSY " : "IDLE ") + highest_flag(now_s));
  return out;
}

void ZaberStage::inject(StageFault fault, double now_s) {
  switch (fault) {
    case StageFault::stall:
      mechanics_.stall(now_s);
      stalled_ = true;
      break;
    case StageFault::limit_switch:
      mechanics_.halt(now_s);
      limit_hit_ = true;
      break;
    case StageFault::lost_position:
      mechanics_.slip(now_s, lost_full_steps);
      break;
    case StageFault::reject_next:
      reject_next_ = true;
      break;
    case StageFault::alert_storm:
      storm_ = 200;
      break;
    case StageFault::power_cycle:
      mechanics_.power_cycle(now_s);
      reset_settings();
      pending_.clear();
      packets_.clear();
      stalled_ = limit_hit_ = noted_interruption_ = reject_next_ = dead_ = false;
      break;
    case StageFault::dead:
      dead_ = true;
      break;
  }
}

}  // namespace

StageLanguage make_zaber() {
  StageLanguage language;
  language.names = {"zaber"};
  language.create = create_stage<ZaberStage>;
  language.usual = [](StagePhysics&) {};
  return language;
}

}  // namespace sim::stages
