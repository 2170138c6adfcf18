// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/awaitable.hpp>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "rig/errors.hpp"
#include "rig/stage/serial_link.hpp"
#include "rig/stage/stage.hpp"
#include "rig/stage/stage_factory.hpp"

namespace rig {

/// What a stage's controller says at one moment, in its own units and sense of rotation.
struct StageReading {
  StageReading() {}
  double position = 0;  ///< Device units.
  bool moving = false;
  bool homed = false;
  std::vector<std::string> warnings;  ///< In words, worst first.
  std::string fault;  ///< In words: why the motion ended where it should not have; empty: nothing is wrong.
};

/// The controller refused a command; it is still there and nothing has moved because of it.
class StageRefusal : public StageError {
  using StageError::StageError;
};

/// With '?' for bytes that are no plain letters. Lines without checksums may be spoilt, and these texts
/// become JSON and words on a terminal.
[[nodiscard]] StageIdentity printable(StageIdentity identity);

/// One language: what is said to a controller, and how its answers are read. It knows device units only, one
/// command at a time, and starts motions without waiting for their end; StageDriver does the rest, alike for
/// all languages.
///
/// Every call throws StageRefusal when the controller says no, StageLost when it does not answer. Commands
/// that got no answer may be given again: all of them mean the same when repeated.
class StageProtocol {
 public:
  template <class T>
  using awaitable = boost::asio::awaitable<T>;

  virtual ~StageProtocol() = default;
  virtual awaitable<StageIdentity> identify() = 0;
  virtual awaitable<StageReading> read() = 0;
  /// Device units per second (0: as it was when identified) and per second squared (0: as it is).
  virtual awaitable<void> set_speed(double speed, double acceleration) = 0;
  virtual awaitable<void> start_homing() = 0;
  virtual awaitable<void> start_move(long long target) = 0;
  /// False: set_speed does nothing, the stage moves as fast as it does.
  [[nodiscard]] virtual bool has_speed() const { return true; }
  /// Turns without end, as far as the language can.
  virtual awaitable<void> start_turn(double speed) = 0;
  virtual awaitable<void> start_stop() = 0;
  /// The bytes that stop the stage, sent before anything that waits its turn. Their answer must not be
  /// mistaken for another's.
  [[nodiscard]] virtual std::string stop_now() = 0;
  /// The bytes that stop whatever goes on, for StageGuard to send when this program is no more.
  [[nodiscard]] virtual std::string stop_for_good() = 0;
  /// The port was lost and is open again: whether the stage kept its power only it can tell.
  virtual void link_was_lost() {}
};

/// A language the rig speaks. Each lives in its own file rig/stage/languages/NAME.cpp, which defines
/// `rig::StageLanguage rig::stages::make_NAME()`; the build finds it by its name.
struct StageLanguage {
  std::vector<std::string> names;  ///< Its dialects.
  int baud = 9600;                 ///< What is usual.
  bool hardware_flow_control = false;
  double zero_deg = 0;  ///< Where the rig's zero is usually laid on the stage's own scale.
  std::function<std::unique_ptr<StageProtocol>(const std::string& dialect, SerialLink& link,
                                               const StageOptions& options)>
      create;
};

}  // namespace rig
