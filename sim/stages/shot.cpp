// SPDX-License-Identifier: MIT
// The device side of Sigma-Koki/OptoSigma controllers in two dialects: `shot` (SHOT-302GS: every command is
// answered OK or NG) and `gsc` (GSC-02: only questions are answered). Moves are queued (M: A: J:) and then
// started (G:); nothing carries an address, an id or a checksum. After the makers' manuals as their users
// quote them; written without regard to our own driver.
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "sim/stage_device.hpp"

namespace sim::stages {
StageLanguage make_shot();
namespace {

constexpr std::size_t longest_command = 256;
constexpr double homing_overrun = 1000;  ///< Pulses from the zero to the limit switch that is sought first.
constexpr double gsc_farthest = 16777214, shot_farthest = 16777214;  ///< Pulses.

struct Speed {
  double start = 500, fastest = 5000, ramp_ms = 200;
};

/// What was queued for an axis, to be started by G:.
struct Queued {
  enum class Kind { nothing, target, jog } kind = Kind::nothing;
  double target = 0;  ///< Pulses; of a jog: its sign.
};

/// Reads a command's arguments from the left.
class Arguments {
 public:
  explicit Arguments(std::string_view text) : rest_(text) {}
  [[nodiscard]] bool at_end() const { return rest_.empty(); }
  [[nodiscard]] char peek() const { return rest_.empty() ? '\0' : rest_.front(); }
  bool take(char wanted) {
    if (peek() != wanted) return false;
    rest_.remove_prefix(1);
    return true;
  }
  std::optional<double> sign() {
    if (take('+')) return 1;
    if (take('-')) return -1;
    return std::nullopt;
  }
  /// Digits only.
  std::optional<double> number() {
    long long value = 0;
    if (rest_.empty() || rest_.front() < '0' || rest_.front() > '9') return std::nullopt;
    const auto [end, failed] = std::from_chars(rest_.data(), rest_.data() + rest_.size(), value);
    if (failed != std::errc()) return std::nullopt;
    rest_.remove_prefix(static_cast<std::size_t>(end - rest_.data()));
    return static_cast<double>(value);
  }
  /// "1", "2", or "W" for all: the axes meant.
  std::optional<std::vector<std::size_t>> axes(std::size_t count) {
    std::vector<std::size_t> all;
    if (take('W')) {
      for (std::size_t i = 0; i < count; ++i) all.push_back(i);
      return all;
    }
    const char digit = peek();
    if (digit < '1' || digit > '9' || static_cast<std::size_t>(digit - '1') >= count) return std::nullopt;
    take(digit);
    all.push_back(static_cast<std::size_t>(digit - '1'));
    return all;
  }

 private:
  std::string_view rest_;
};

/// The stage is on the first axis. The second has a motor that nothing hangs on: it counts at once.
class ShotStage : public StageDevice {
 public:
  explicit ShotStage(const StageDeviceOptions& options)
      : mechanics_(options.physics),
        units_per_deg_(options.physics.units_per_deg),
        is_gsc_(options.language == "gsc"),
        axes_(static_cast<std::size_t>(std::clamp(options.axes, 1, 2))),
        acknowledges_at_start_(options.acknowledges.value_or(!is_gsc_)),
        acknowledges_(acknowledges_at_start_) {
    use_speed(Speed());
    if (options.homed) mechanics_.home(-1e9);
  }

  std::string receive(std::string_view bytes, double now_s) override;
  std::string poll(double now_s) override {
    notice_end(now_s);
    return "";
  }
  StageMechanics& mechanics() override { return mechanics_; }
  void inject(StageFault fault, double now_s) override;
  [[nodiscard]] int baud() const override { return 9600; }

 private:
  std::string line(std::string_view text, double now_s);
  std::string question(std::string_view text, double now_s);
  [[nodiscard]] std::optional<std::string> setting_asked_for(std::string_view text) const;
  bool obey(std::string_view text, double now_s);
  bool queue_move(char verb, Arguments arguments, double now_s);
  bool queue_jog(Arguments arguments);
  bool start(double now_s);
  bool home(Arguments arguments, double now_s);
  bool stop(Arguments arguments, double now_s);
  bool count_from_here(Arguments arguments, double now_s);
  bool set_speed(char verb, Arguments arguments);
  bool set_division(Arguments arguments);
  bool excite(Arguments arguments);
  void use_speed(const Speed& speed);
  void drive(double target, double now_s);
  void notice_end(double now_s);
  [[nodiscard]] bool busy(double now_s) const { return mechanics_.moving(now_s); }
  [[nodiscard]] std::string status(double now_s) const;
  [[nodiscard]] double position(std::size_t axis, double now_s) const {
    return axis == 0 ? std::round(mechanics_.position_units(now_s)) : second_;
  }

  StageMechanics mechanics_;
  double units_per_deg_;
  bool is_gsc_;
  std::size_t axes_;
  bool acknowledges_at_start_, acknowledges_;
  std::string pending_;
  bool pending_spoilt_ = false;
  std::array<Queued, 2> queued_;
  std::array<bool, 2> excited_{true, true};
  Speed speed_;  ///< In use by the first axis.
  std::array<Speed, 2> speeds_, homing_speeds_;
  std::array<int, 2> divisions_{2, 2};  ///< Half steps.
  double second_ = 0;
  bool refused_ = false;                            ///< The last command: A1 of the status.
  bool at_limit_ = false, is_limit_ahead_ = false;  ///< The motion ended, or will end, at a limit switch.
  bool reject_next_ = false, dead_ = false;
};

// --- bytes to lines ---

/// A command ends with CR LF; anything else is part of it.
std::string ShotStage::receive(std::string_view bytes, double now_s) {
  if (dead_) return "";
  notice_end(now_s);
  std::string out;
  for (const char c : bytes) {
    if (c == '\n' && !pending_.empty() && pending_.back() == '\r') {
      pending_.pop_back();
      const std::string text = std::exchange(pending_, "");
      if (std::exchange(pending_spoilt_, false))
        refused_ = true;
      else if (!text.empty())
        out += line(text, now_s);
    } else if (pending_.size() >= longest_command) {
      pending_spoilt_ = true;
      pending_ = c == '\r' ? "\r" : "";
    } else {
      pending_ += c;
    }
  }
  return out;
}

std::string ShotStage::line(std::string_view text, double now_s) {
  if (text == "I:" && !is_gsc_) return "0\r\n";  // Nothing is connected to its inputs.
  if (text.starts_with("Q:") || text.starts_with("!:") || text.starts_with("?:"))
    return question(text, now_s);
  refused_ = !obey(text, now_s);
  if (!acknowledges_) return "";
  return refused_ ? "NG\r\n" : "OK\r\n";
}

std::string ShotStage::question(std::string_view text, double now_s) {
  if (text == "Q:") return status(now_s) + "\r\n";
  if (text == "!:") return busy(now_s) ? "B\r\n" : "R\r\n";
  if (text == "?:V") return is_gsc_ ? "V2.10\r\n" : "V3.00\r\n";
  if (text == "?:N" && !is_gsc_) return axes_ == 1 ? "GIP-101\r\n" : "SHOT-302GS\r\n";
  if (text == "?:N" && axes_ == 1) return "GSC-01\r\n";
  if (const auto setting = setting_asked_for(text)) return *setting + "\r\n";
  refused_ = true;
  return acknowledges_ ? "NG\r\n" : "";
}

/// ?:D1, ?:DW and the like: speeds (D) and those of homing (B), of one axis or of all; divisions of a step
/// (S) and the travel of a pulse (P), parted by commas.
std::optional<std::string> ShotStage::setting_asked_for(std::string_view text) const {
  if (is_gsc_ || text.size() != 4) return std::nullopt;
  const char what = text[2];
  Arguments arguments(text.substr(3));
  const auto axes = arguments.axes(axes_);
  if (!axes || std::string_view("DBSP").find(what) == std::string_view::npos) return std::nullopt;
  std::string answer;
  for (const std::size_t axis : *axes) {
    std::array<char, 64> field{};
    if (what == 'S')
      std::snprintf(field.data(), field.size(), "%d", divisions_.at(axis));
    else if (what == 'P')
      std::snprintf(field.data(), field.size(), "%g", 1 / units_per_deg_);
    else {
      const Speed& speed = what == 'D' ? speeds_.at(axis) : homing_speeds_.at(axis);
      std::snprintf(field.data(), field.size(), "S%.0fF%.0fR%.0f", speed.start, speed.fastest, speed.ramp_ms);
    }
    const bool parted = !answer.empty() && (what == 'S' || what == 'P');
    answer += (parted ? "," : "") + std::string(field.data());
  }
  return answer;
}

/// Ten characters an axis (sign, blanks, digits), then: was the last command understood, which limits were
/// hit, busy.
std::string ShotStage::status(double now_s) const {
  std::string text;
  for (std::size_t axis = 0; axis < axes_; ++axis) {
    const double at = position(axis, now_s);
    std::array<char, 32> field{};
    std::snprintf(field.data(), field.size(), "%c%9.0f,", at < 0 ? '-' : ' ', std::abs(at));
    text += field.data();
  }
  text += refused_ ? "X," : "K,";
  text += at_limit_ && !busy(now_s) ? "L," : "K,";
  return text + (busy(now_s) ? "B" : "R");
}

// --- commands ---

bool ShotStage::obey(std::string_view text, double now_s) {
  if (text == "ACK:0" || text == "ACK:1") {
    if (!is_gsc_) return false;
    acknowledges_ = text.back() == '1';
    return true;
  }
  const bool is_go = text == "G:" || text == "G";
  if (!is_go && (text.size() < 3 || text[1] != ':')) return false;
  const char verb = text[0];
  const Arguments arguments(is_go ? std::string_view() : text.substr(2));
  if (verb == 'L') return stop(arguments, now_s);
  if (busy(now_s)) return false;
  const bool moves = verb == 'M' || verb == 'A' || verb == 'J' || verb == 'G' || verb == 'H';
  if (moves && std::exchange(reject_next_, false)) return false;
  switch (verb) {
    case 'M':
    case 'A':
      return queue_move(verb, arguments, now_s);
    case 'J':
      return queue_jog(arguments);
    case 'G':
      return start(now_s);
    case 'H':
      return home(arguments, now_s);
    case 'R':
      return count_from_here(arguments, now_s);
    case 'D':
    case 'V':
      return (verb == 'D' || !is_gsc_) && set_speed(verb, arguments);
    case 'C':
      return excite(arguments);
    case 'O':
      return !is_gsc_ && (text == "O:0" || text == "O:1");  // Nothing hangs on its output.
    case 'S':
      return set_division(arguments);
    default:
      return false;
  }
}

bool ShotStage::queue_move(char verb, Arguments arguments, double now_s) {
  if (verb == 'A' && is_gsc_ && axes_ > 1) return false;  // The GSC-02 has relative moves only.
  const auto axes = arguments.axes(axes_);
  if (!axes) return false;
  std::array<Queued, 2> queue;
  for (const std::size_t axis : *axes) {
    const auto sign = arguments.sign();
    if (!sign || !arguments.take('P')) return false;
    const auto pulses = arguments.number();
    const double farthest = is_gsc_ ? gsc_farthest : shot_farthest;
    if (!pulses || *pulses > farthest || !excited_.at(axis)) return false;
    const double target = *sign * *pulses + (verb == 'M' ? position(axis, now_s) : 0);
    if (std::abs(target) > farthest) return false;
    queue.at(axis) = {Queued::Kind::target, target};
  }
  if (!arguments.at_end()) return false;
  queued_ = queue;
  return true;
}

bool ShotStage::queue_jog(Arguments arguments) {
  const auto axes = arguments.axes(axes_);
  if (!axes) return false;
  std::array<Queued, 2> queue;
  for (const std::size_t axis : *axes) {
    const auto sign = arguments.sign();
    if (!sign || !excited_.at(axis)) return false;
    queue.at(axis) = {Queued::Kind::jog, *sign};
  }
  if (!arguments.at_end()) return false;
  queued_ = queue;
  return true;
}

bool ShotStage::start(double now_s) {
  const std::array<Queued, 2> queue = std::exchange(queued_, {});
  if (queue[0].kind == Queued::Kind::nothing && queue[1].kind == Queued::Kind::nothing) return false;
  if (queue[1].kind == Queued::Kind::target) second_ = queue[1].target;
  if (queue[0].kind == Queued::Kind::target) {
    use_speed(speed_);
    drive(queue[0].target, now_s);
  } else if (queue[0].kind == Queued::Kind::jog) {
    mechanics_.set_speed(speed_.start);
    drive(queue[0].target * shot_farthest, now_s);
  }
  return true;
}

/// No farther than the limit switches, which stop the motor and are remembered until the next motion.
void ShotStage::drive(double target, double now_s) {
  const double low = std::ceil(mechanics_.min_units(now_s)), high = std::floor(mechanics_.max_units(now_s));
  is_limit_ahead_ = target < low || target > high;
  at_limit_ = false;
  mechanics_.move_to(now_s, std::clamp(target, std::min(low, high), high));
}

void ShotStage::notice_end(double now_s) {
  if (is_limit_ahead_ && !busy(now_s)) {
    is_limit_ahead_ = false;
    at_limit_ = true;
  }
}

/// The way of small stages (MINI): to the limit switch, back, and there is the zero. The switch is on the
/// minus side.
bool ShotStage::home(Arguments arguments, double now_s) {
  const auto axes = arguments.axes(axes_);
  if (!axes) return false;
  bool to_plus = false;
  for (const std::size_t axis : *axes) {
    const auto sign = arguments.sign();
    if (is_gsc_ && axes_ > 1 && !sign) return false;
    if (axis == 0) to_plus = sign && *sign > 0 && is_gsc_;
    if (!excited_.at(axis)) return false;
  }
  if (!arguments.at_end()) return false;
  queued_ = {};
  for (const std::size_t axis : *axes) {
    if (axis == 1) second_ = 0;
    if (axis == 0 && to_plus) drive(shot_farthest, now_s);  // There is no switch to turn back at.
    if (axis == 0 && !to_plus) {
      at_limit_ = is_limit_ahead_ = false;
      mechanics_.home(now_s, homing_overrun);
    }
  }
  return true;
}

bool ShotStage::stop(Arguments arguments, double now_s) {
  const bool at_once = arguments.take('E');
  const auto axes = at_once ? std::optional(std::vector<std::size_t>{0}) : arguments.axes(axes_);
  if (!axes || !arguments.at_end()) return false;
  queued_ = {};
  if (std::ranges::count(*axes, 0U) == 0) return true;
  if (!at_once && mechanics_.homing(now_s)) return true;  // Homing heeds only L:E.
  is_limit_ahead_ = false;
  if (at_once)
    mechanics_.halt(now_s);
  else
    mechanics_.stop(now_s);
  return true;
}

bool ShotStage::count_from_here(Arguments arguments, double now_s) {
  const auto axes = arguments.axes(axes_);
  if (!axes || !arguments.at_end()) return false;
  for (const std::size_t axis : *axes) {
    if (axis == 0) mechanics_.count_from(now_s, 0);
    if (axis == 1) second_ = 0;
  }
  return true;
}

// --- settings ---

/// D:1S500F5000R200 for an axis, D:W with a triplet an axis; the GSC-02 says a range (1 slow, 2 fast) and
/// both triplets.
bool ShotStage::set_speed(char verb, Arguments arguments) {
  const char which = arguments.peek();
  if (which != '1' && which != '2' && which != 'W') return false;
  arguments.take(which);
  std::vector<Speed> speeds;
  const double most = is_gsc_ ? 20000 : 500000;
  while (arguments.take('S')) {
    const auto start = arguments.number();
    if (!start || !arguments.take('F')) return false;
    const auto fastest = arguments.number();
    if (!fastest || !arguments.take('R')) return false;
    const auto ramp_ms = arguments.number();
    if (!ramp_ms || *start < 1 || *fastest < *start || *fastest > most || *ramp_ms > 1000) return false;
    speeds.push_back({*start, *fastest, *ramp_ms});
  }
  const bool is_for_all = which == 'W' || speeds.size() == 2;
  if (!arguments.at_end() || speeds.empty() || speeds.size() > axes_) return false;
  if (which == 'W' && speeds.size() != axes_) return false;
  if (is_gsc_ && is_for_all && which == '1' && speeds[0].fastest > 200) return false;
  std::array<Speed, 2>& kept = verb == 'D' ? speeds_ : homing_speeds_;
  if (is_for_all)
    std::copy(speeds.begin(), speeds.end(), kept.begin());
  else
    kept.at(static_cast<std::size_t>(which - '1')) = speeds[0];
  if (verb == 'D' && (is_for_all || which == '1')) use_speed(speeds[0]);
  return true;
}

void ShotStage::use_speed(const Speed& speed) {
  speed_ = speed;
  mechanics_.set_speed(speed.fastest);
  mechanics_.set_acceleration((std::max(speed.fastest - speed.start, 1.0)) /
                              std::max(speed.ramp_ms / 1e3, 1e-3));
}

/// Kept and told; the bench file says what a pulse is. Jog speed and origin offset are accepted.
bool ShotStage::set_division(Arguments arguments) {
  const auto axes = arguments.axes(axes_);
  const auto division = axes ? arguments.number() : std::nullopt;
  if (division && arguments.at_end() && *division >= 1 && *division <= 250)
    for (const std::size_t axis : *axes) divisions_.at(axis) = static_cast<int>(*division);
  return true;
}

bool ShotStage::excite(Arguments arguments) {
  const auto axes = arguments.axes(axes_);
  const auto on = arguments.number();
  if (!axes || !on || *on > 1 || !arguments.at_end()) return false;
  for (const std::size_t axis : *axes) excited_.at(axis) = *on == 1;
  return true;
}

// --- what goes wrong ---

void ShotStage::inject(StageFault fault, double now_s) {
  switch (fault) {
    case StageFault::stall:  // The language has no word for it: the motion has ended, that is all.
      is_limit_ahead_ = false;
      mechanics_.stall(now_s);
      break;
    case StageFault::limit_switch:
      mechanics_.halt(now_s);
      is_limit_ahead_ = false;
      at_limit_ = true;
      break;
    case StageFault::lost_position:
      mechanics_.slip(now_s, lost_full_steps);
      break;
    case StageFault::reject_next:
      reject_next_ = true;
      break;
    case StageFault::alert_storm:
      break;
    case StageFault::power_cycle:
      mechanics_.power_cycle(now_s);
      queued_ = {};
      excited_ = {true, true};
      second_ = 0;
      speeds_ = homing_speeds_ = {};
      divisions_ = {2, 2};
      use_speed(Speed());
      acknowledges_ = acknowledges_at_start_;
      pending_.clear();
      pending_spoilt_ = refused_ = at_limit_ = is_limit_ahead_ = reject_next_ = dead_ = false;
      break;
    case StageFault::dead:
      dead_ = true;
      break;
  }
}

}  // namespace

StageLanguage make_shot() {
  StageLanguage language;
  language.names = {"shot", "gsc"};
  language.create = create_stage<ShotStage>;
  // A yaw stage with a 144:1 worm and a 0.72 deg motor in half steps: 0.0025 deg a pulse.
  language.usual = [](StagePhysics& physics) {
    physics.units_per_deg = 400;
    physics.speed_deg_s = 12.5;
    physics.acceleration_deg_s2 = 56.25;
    physics.homing_speed_deg_s = 12.5;
    physics.full_step_deg = 0.005;
    physics.worm_teeth = 144;
  };
  return language;
}

}  // namespace sim::stages
