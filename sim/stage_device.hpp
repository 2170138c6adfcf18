// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "sim/stage_mechanics.hpp"

namespace sim {

/// What can go wrong with a simulated stage beyond its line (whose faults are PtyPort's).
enum class StageFault {
  stall,  ///< The rotor stands in the middle of a move; the controller notices and says so, if it has a word
          ///< for it.
  limit_switch,   ///< An end switch is hit where none should be; the motion stops.
  lost_position,  ///< The rotor slips by lost_full_steps; nothing notices.
  reject_next,    ///< The next motion command is refused.
  alert_storm,    ///< 200 unsolicited lines at once (languages without such lines ignore it).
  power_cycle,    ///< Power is lost and comes back: not homed, motion gone, settings at their defaults.
  dead,           ///< It no longer answers anything until power_cycle.
};

constexpr double lost_full_steps = 10;  ///< Of StageFault::lost_position.

/// A simulated stage controller speaking one language: bytes and time in, bytes out; no I/O.
class StageDevice {
 public:
  virtual ~StageDevice() = default;
  /// Takes bytes, cut anywhere; returns what the device answers.
  virtual std::string receive(std::string_view bytes, double now_s) = 0;
  /// What it says unasked at this time; empty in most languages.
  virtual std::string poll(double now_s) = 0;
  virtual StageMechanics& mechanics() = 0;
  virtual void inject(StageFault fault, double now_s) = 0;
  /// The speed of its line; a client at another baud rate gets garbage when PtyPort::Options::strict_baud is
  /// set.
  [[nodiscard]] virtual int baud() const = 0;
};

/// What a simulated stage is made of.
struct StageDeviceOptions {
  StagePhysics physics;
  std::string language = "zaber";  ///< "zaber", "shot", "gsc", "falcon".
  int address = 1;                 ///< On a shared line (Zaber).
  bool homed = false;              ///< Starts homed, as a stage that kept its power.
  int axes = 2;                    ///< Of the controller, the stage being on the first (shot, gsc).
  std::optional<bool>
      acknowledges;  ///< Answers commands with OK or NG; by default `shot` does and `gsc` not.
};

/// A device as StageLanguage::create makes it.
template <class Device>
std::unique_ptr<StageDevice> create_stage(const StageDeviceOptions& options) {
  return std::make_unique<Device>(options);
}

/// A language a simulated stage can speak. Each lives in its own file stages/NAME.cpp, which defines
/// `sim::StageLanguage sim::stages::make_NAME()`; the build finds it by its name.
struct StageLanguage {
  std::vector<std::string> names;  ///< Its dialects.
  std::function<std::unique_ptr<StageDevice>(const StageDeviceOptions&)> create;
  std::function<void(StagePhysics&)>
      usual;            ///< Fills in what is usual for a stage of this kind (units per degree, ends).
  double zero_deg = 0;  ///< Where the bench's zero is usually laid on the stage's own scale.
};

/// Throws std::invalid_argument naming the known languages if this one is not among them.
std::unique_ptr<StageDevice> make_stage_device(const StageDeviceOptions& options);
/// The physics of an ideal stage that usually speaks `language`. Throws as above.
StagePhysics usual_stage_physics(const std::string& language);
/// Where the bench's zero is usually laid on the stage's own scale, degrees. Throws as above.
double usual_stage_zero_deg(const std::string& language);

}  // namespace sim
