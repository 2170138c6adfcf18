// SPDX-License-Identifier: MIT
// The device side of the Pegasus Falcon rotator: degrees with two decimals, lines that end with LF. There is
// no public description; this is what Debian's INDI driver (indi_falcon_rotator 1.9.9) says and understands.
// Written without regard to our own driver.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>
#include <utility>

#include "sim/stage_device.hpp"

namespace sim::stages {
StageLanguage make_falcon();
namespace {

constexpr std::size_t longest_command = 64;

/// Plain digits with at most one point and a leading minus, nothing else.
std::optional<double> decimal(std::string_view text) {
  const bool is_negative = text.starts_with('-');
  if (is_negative) text.remove_prefix(1);
  if (text.empty() || text.size() > 9) return std::nullopt;
  double value = 0, place = 0;
  for (const char c : text) {
    if (c == '.' && place == 0) {
      place = 1;
    } else if (c >= '0' && c <= '9') {
      value = value * 10 + (c - '0');
      place *= 10;
    } else {
      return std::nullopt;
    }
  }
  if (place > 0) value /= place;
  return is_negative ? -value : value;
}

class FalconStage : public StageDevice {
 public:
  explicit FalconStage(const StageDeviceOptions& options) : mechanics_(options.physics) {
    // It keeps its zero without power.
    mechanics_.count_from(-1e9, options.physics.power_on_deg * options.physics.units_per_deg);
  }

  std::string receive(std::string_view bytes, double now_s) override;
  std::string poll(double) override { return ""; }
  StageMechanics& mechanics() override { return mechanics_; }
  void inject(StageFault fault, double now_s) override;
  [[nodiscard]] int baud() const override { return 9600; }

 private:
  std::string answer(std::string_view text, double now_s);
  std::string move(std::string_view text, double now_s);
  std::string sync(std::string_view text, double now_s);
  [[nodiscard]] std::string report(double now_s) const;
  [[nodiscard]] double shown_deg(double now_s) const;

  StageMechanics mechanics_;
  std::string pending_;
  bool is_spoilt_ = false, reversed_ = false, at_limit_ = false, reject_next_ = false, dead_ = false;
  int derotation_ms_ = 0;
};

std::string FalconStage::receive(std::string_view bytes, double now_s) {
  if (dead_) return "";
  std::string out;
  for (const char c : bytes) {
    if (c == '\n') {
      const std::string text = std::exchange(pending_, "");
      if (!std::exchange(is_spoilt_, false)) out += answer(text, now_s);
    } else if (c == '\r') {
      continue;
    } else if (pending_.size() >= longest_command) {
      is_spoilt_ = true;
    } else {
      pending_ += c;
    }
  }
  return out;
}

std::string FalconStage::answer(std::string_view text, double now_s) {
  if (text == "F#") return "FR_OK\n";
  if (text == "FV") return "FV:1.3\n";
  if (text == "FA") return report(now_s);
  if (text == "FD") {
    std::array<char, 32> line{};
    std::snprintf(line.data(), line.size(), "FD:%.2f\n", shown_deg(now_s));
    return line.data();
  }
  if (text == "FP") return "FP:" + std::to_string(std::llround(mechanics_.position_units(now_s))) + "\n";
  if (text == "FH") {
    mechanics_.stop(now_s);
    return "FH:1\n";
  }
  if (text == "FR") return mechanics_.moving(now_s) ? "FR:1\n" : "FR:0\n";
  if (text == "FN:0" || text == "FN:1" || text == "FR:0" || text == "FR:1") {
    reversed_ = text.back() == '1';
    return std::string(text) + "\n";
  }
  if (text.starts_with("MD:")) return move(text, now_s);
  if (text.starts_with("SD:")) return sync(text, now_s);
  if (text.starts_with("DR:")) {
    const auto ms = decimal(text.substr(3));
    if (!ms || *ms < 0 || *ms > 10000) return "";
    derotation_ms_ = static_cast<int>(*ms);  // It is reported; the table is not turned by it.
    return std::string(text) + "\n";
  }
  return "";
}

/// 0 to 360 from its own zero, which it never passes: the cable is not wound up.
std::string FalconStage::move(std::string_view text, double now_s) {
  const auto deg = decimal(text.substr(3));
  if (!deg || *deg < 0 || *deg > 360 || std::exchange(reject_next_, false)) return "";
  const double target = (reversed_ ? 360 - *deg : *deg) * mechanics_.physics().units_per_deg;
  at_limit_ = false;
  mechanics_.move_to(now_s, std::clamp(target, mechanics_.min_units(now_s), mechanics_.max_units(now_s)));
  return std::string(text) + "\n";
}

std::string FalconStage::sync(std::string_view text, double now_s) {
  const auto deg = decimal(text.substr(3));
  if (!deg || *deg < 0 || *deg > 360 || mechanics_.moving(now_s)) return "";
  mechanics_.count_from(now_s, (reversed_ ? 360 - *deg : *deg) * mechanics_.physics().units_per_deg);
  return std::string(text) + "\n";
}

double FalconStage::shown_deg(double now_s) const {
  const double deg = mechanics_.position_units(now_s) / mechanics_.physics().units_per_deg;
  const double shown = std::fmod(reversed_ ? 360 - deg : deg, 360);
  return std::round((shown < 0 ? shown + 360 : shown) * 100) / 100;
}

/// FR_OK:steps:degrees:moving:limit:derotation:reverse
std::string FalconStage::report(double now_s) const {
  std::array<char, 96> line{};
  std::snprintf(line.data(), line.size(), "FR_OK:%lld:%.2f:%d:%d:%d:%d\n",
                std::llround(mechanics_.position_units(now_s)), shown_deg(now_s),
                static_cast<int>(mechanics_.moving(now_s)), static_cast<int>(at_limit_),
                static_cast<int>(derotation_ms_ > 0), static_cast<int>(reversed_));
  return line.data();
}

void FalconStage::inject(StageFault fault, double now_s) {
  switch (fault) {
    case StageFault::stall:  // Open loop and without a word for it: the motion has ended, that is all.
      mechanics_.stall(now_s);
      break;
    case StageFault::limit_switch:
      mechanics_.halt(now_s);
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
      mechanics_.halt(now_s);
      pending_.clear();
      derotation_ms_ = 0;
      is_spoilt_ = at_limit_ = reject_next_ = dead_ = false;
      break;
    case StageFault::dead:
      dead_ = true;
      break;
  }
}

}  // namespace

StageLanguage make_falcon() {
  StageLanguage language;
  language.names = {"falcon"};
  language.create = create_stage<FalconStage>;
  language.usual = [](StagePhysics& physics) {
    physics.units_per_deg = 400;
    physics.speed_deg_s = physics.homing_speed_deg_s = 6;
    physics.acceleration_deg_s2 = 30;
    physics.min_deg = 0;
    physics.max_deg = 360;
    physics.power_on_deg = 180;
    physics.full_step_deg = 0.01;
  };
  language.zero_deg = 180;
  return language;
}

}  // namespace sim::stages
