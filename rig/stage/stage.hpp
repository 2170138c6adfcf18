// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/awaitable.hpp>
#include <chrono>
#include <string>
#include <vector>

namespace rig {

/// Who the stage says it is.
struct StageIdentity {
  std::string language;  ///< "zaber", "shot", "gsc", "falcon".
  std::string model, serial, firmware;
  double units_per_deg = 0;  ///< Device units (microsteps, pulses) in a degree.
};

/// What the stage says of itself at one moment.
struct StageStatus {
  double position_deg = 0;
  bool moving = false;
  bool homed = false;
  std::vector<std::string> warnings;  ///< In words, worst first.
};

/// A rotary stage, whatever its language. Angles in degrees, counter-clockwise, as commanded by procedures.
/// Every operation has a deadline of its own and throws StageError (rig/errors.hpp), or StageLost when the
/// link is gone; every one may be cancelled (the stage is then stopped by the caller with stop(), which is
/// never refused). stop() may be called while another operation waits: it goes before all others, and that
/// operation then ends with StageError.
class Stage {
 public:
  template <class T>
  using awaitable = boost::asio::awaitable<T>;

  virtual ~Stage() = default;
  virtual awaitable<StageIdentity> identify() = 0;
  virtual awaitable<StageStatus> status() = 0;
  virtual awaitable<void> home() = 0;
  /// Moves to an absolute angle, rounded to whole device units; returns the angle the stage reads back after
  /// it has settled. The caller judges the difference.
  virtual awaitable<double> move_to(double target_deg) = 0;
  /// Turns at a constant rate until stop() or another move.
  virtual awaitable<void> turn(double rate_deg_s) = 0;
  virtual awaitable<void> stop() = 0;
  /// After StageLost: closes the port, opens it again by its name, identifies the device (which must be the
  /// same) and stops it if it moves. It may have to be homed again; status() says so.
  virtual awaitable<void> reopen() = 0;
};

}  // namespace rig
