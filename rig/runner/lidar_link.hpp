// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/awaitable.hpp>
#include <cstdint>
#include <exception>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

#include "rig/runner/placed_bench.hpp"
#include "rig/runner/run_control.hpp"
#include "rig/runner/run_status.hpp"
#include "rig/runner/scan_gate.hpp"
#include "rig/runner/session_clock.hpp"

namespace rig {

/// The lidar as a run has it: the one of the bench file and of the session, reconnected when it is lost, its
/// stream started and stopped, and its restarts recorded. A lidar that reconnects and never measures is lost.
class LidarLink {
 public:
  /// `parts`, for its lidar, its clock, its locks and the operator's decision, and the rest are kept by
  /// reference.
  LidarLink(RunnerParts& parts, const fit::Bench& bench, SessionStore& session, SessionClock& time,
            const PlacedBench& placed, RunStatus& status, const RunControl& control);

  [[nodiscard]] LidarSource& source() { return lidar_; }
  [[nodiscard]] bool connected() const { return connected_; }
  /// It says so of itself.
  [[nodiscard]] bool simulated() const { return simulated_; }
  /// The latest stamp since it was connected.
  [[nodiscard]] std::optional<std::uint64_t> seen_ms() const { return seen_ms_; }
  /// Restarts of its clock that were reported.
  [[nodiscard]] int clock_restarts() const { return clock_restarts_; }

  // Connecting

  /// The first connection of a run: a lidar that was switched on just now is waited for.
  boost::asio::awaitable<void> await_first();
  /// Brings a lost lidar back or gives up with a DeviceError.
  boost::asio::awaitable<void> reconnect(std::exception_ptr why);
  /// The operator switched it off and on.
  boost::asio::awaitable<void> reconnect_after_power_cycle();
  /// One attempt for a lidar that was lost while a person works at the bench.
  boost::asio::awaitable<void> reconnect_once();
  /// It was found lost: whatever it streamed is over.
  void lost() { streaming_ = false; }
  /// Reconnects a lidar whose scans do not belong to the capture (its timer may have jumped), unless that
  /// happened too often since the caller last got what it wanted.
  boost::asio::awaitable<void> reconnect_for_unfit_scans(const CaptureRequest& request, int& failures);
  [[nodiscard]] static std::string unfit_scans(const CaptureRequest& request);
  /// Whether the device's clock runs with the host's: a simulation at full speed does not.
  boost::asio::awaitable<void> compare_clocks();

  // Streaming

  boost::asio::awaitable<void> start(LidarStream stream);
  /// A start that may be called off half-way, which leaves the device streaming as well.
  boost::asio::awaitable<void> start_to_watch(LidarStream stream);
  /// Once; the failure is the caller's.
  boost::asio::awaitable<void> end();
  /// A lidar that is lost meanwhile is reconnected.
  boost::asio::awaitable<void> stop();
  /// The next scan. The stream is started when none runs, and then `gate` begins anew; a lidar that was lost
  /// is reconnected unless that happened too often (`failures`) since the caller last got what it wanted.
  boost::asio::awaitable<lidar::Scan> next(LidarStream stream, ScanGate* gate, int& failures);
  void show(const lidar::Scan& scan);
  /// Reports and stores that its clock started again before this scan, if it did: for scans that did not come
  /// from next().
  void report_clock_restart(const lidar::Scan& scan);

  /// What its driver counted in this run, as an event and under "lidar_statistics".
  void record_statistics();

 private:
  boost::asio::awaitable<void> connect();
  /// Tries for as long as a lidar takes to start; `why` it is gone so far, if known.
  boost::asio::awaitable<void> connect_again(std::exception_ptr why);
  /// Throws if it is not what the bench file describes, or reports a fault and the operator has not decided
  /// to use it all the same.
  void judge(const nlohmann::json& identity);

  RunnerParts& parts_;
  LidarSource& lidar_;
  const fit::Bench& bench_;
  SessionStore& session_;
  SessionClock& time_;
  const PlacedBench& placed_;
  RunStatus& status_;
  const RunControl& control_;
  bool connected_ = false, streaming_ = false, simulated_ = false;
  bool power_cycle_announced_ = false, intensities_missed_ = false;
  std::optional<std::uint64_t> seen_ms_;
  int clock_restarts_ = 0;
  struct Loss {
    std::int64_t reported_us = 0;
    int unreported = 0;  ///< Since then.
  };
  std::map<std::string, Loss> losses_;  ///< By what people were told; its like are counted for a minute.
  std::string accepted_;                ///< What was said of it when it was accepted all the same.
};

}  // namespace rig
