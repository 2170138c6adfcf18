// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "sim/clock.hpp"
#include "sim/pty_port.hpp"
#include "sim/scip_server.hpp"
#include "sim/stage_device.hpp"
#include "sim/ust_device.hpp"

namespace sim {

/// A fault that happened.
struct FaultEvent {
  double time_s;     ///< Simulated.
  std::string text;  ///< "stage stall", "lidar lose bytes=3".
};

/// Makes a bench go wrong, by schedule, at random with a seed, or on demand:
///
///   at=12.5s lidar reset        once, at that simulated time
///   every=60s stage delay s=0.4 again and again
///   random rate=0.02 stage      on average so many a simulated second, any fault of the stage (or `lidar`,
///   or all) lidar lose bytes=3          at once
///
/// The faults there are: `FaultInjector::catalogue()`. Everything attached must outlive it.
class FaultInjector {
 public:
  struct Bench {
    ScipServer* server = nullptr;
    UstDevice* lidar = nullptr;
    PtyPort* port = nullptr;
    StageDevice* stage = nullptr;
  };

  /// Takes over the faults of the server and of the port; null devices have no faults.
  FaultInjector(const boost::asio::any_io_executor& executor, SimClock& clock, const Bench& bench,
                std::uint64_t seed = 1);
  ~FaultInjector();
  FaultInjector(const FaultInjector&) = delete;
  FaultInjector& operator=(const FaultInjector&) = delete;

  /// One line as above. Throws std::invalid_argument saying what is wrong with it.
  void add(const std::string& line);
  /// A file of such lines; # begins a comment. Throws std::invalid_argument naming file and line.
  void add_file(const std::string& path);
  /// Called for every fault as it happens.
  void observe(std::function<void(const FaultEvent&)> observer);
  /// The latest ten thousand.
  [[nodiscard]] std::vector<FaultEvent> events() const;
  [[nodiscard]] std::uint64_t count() const;

  /// All faults with their parameters, one a line.
  static std::string catalogue();

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

}  // namespace sim
