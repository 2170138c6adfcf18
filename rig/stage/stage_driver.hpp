// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/any_io_executor.hpp>

#include "rig/stage/stage_language.hpp"

namespace rig {

/// What is alike for stages of every language: angles and whole device units, soft limits, homing demanded,
/// waiting for the end of a motion, settling, judging the read-back, and stopping before all else. One
/// command is on the line at a time.
class StageDriver : public Stage {
 public:
  StageDriver(boost::asio::any_io_executor executor, StageOptions options, std::unique_ptr<SerialLink> link,
              std::unique_ptr<StageProtocol> protocol);
  ~StageDriver() override;

  /// Asks the device who it is and stops it if it moves; to be awaited before anything else.
  awaitable<void> start();

  awaitable<StageIdentity> identify() override;
  awaitable<StageStatus> status() override;
  awaitable<void> home() override;
  awaitable<double> move_to(double target_deg) override;
  awaitable<void> turn(double rate_deg_s) override;
  awaitable<void> stop() override;
  awaitable<void> reopen() override;

 private:
  struct Line;       ///< Who uses the line, and who waits for it.
  struct Heartbeat;  ///< Tells the guard that this program is alive while the stage moves.
  class Turn;        ///< The right to use it.
  class Place;       ///< Among those who wait.

  awaitable<Turn> take_turn(std::size_t stops);
  awaitable<StageIdentity> who();
  awaitable<void> stop_once();
  awaitable<void> pause(double seconds) const;
  awaitable<StageReading> read(std::size_t stops);
  /// Two equal answers in a row: a byte spoilt on the line must not become a measured angle.
  awaitable<StageReading> read_twice(std::size_t stops);
  awaitable<void> use_speed(double deg_s, std::size_t stops);
  awaitable<StageReading> wait_for_rest(const std::string& activity, double longest_s, std::size_t stops);
  awaitable<void> start_move(long long units, std::size_t stops);
  awaitable<void> demand_homed(std::size_t stops);
  void demand_within_limits(double deg) const;
  void demand_not_stopped(std::size_t stops) const;
  [[nodiscard]] long long to_units(double deg) const;
  [[nodiscard]] double to_deg(double units) const;

  boost::asio::any_io_executor executor_;
  StageOptions options_;
  std::unique_ptr<SerialLink> link_;
  std::unique_ptr<StageProtocol> protocol_;
  StageIdentity identity_;
  std::shared_ptr<Line> line_;
  std::shared_ptr<Heartbeat> heartbeat_;
  std::size_t stops_ = 0;      ///< Counts stop(): whoever began before the last one gives up.
  bool found_moving_ = false;  ///< By start(); told once, by status().
  double speed_deg_s_ = 0;     ///< As last commanded; 0: the device's own.
};

}  // namespace rig
