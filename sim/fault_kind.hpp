// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "sim/faults.hpp"
#include "sim/message_faults.hpp"
#include "sim/random.hpp"

namespace sim {

using FaultParameters = std::map<std::string, double>;

/// The bench, as faults see it.
struct FaultSite {
  using ByteFault = std::function<void(std::string& bytes)>;
  /// Waits for a message that it concerns.
  struct WaitingFault {
    MessageFault::Of of;
    std::function<void(std::string& message)> change;
  };

  FaultSite(SimClock& clock_, const FaultInjector::Bench& bench_, std::uint64_t seed)
      : clock(clock_), bench(bench_), random(seed) {}
  virtual ~FaultSite() = default;
  /// Real seconds: what the bench's people do (plugging, switching) takes their time.
  virtual void later(double seconds, std::function<void()> then) = 0;

  SimClock& clock;
  FaultInjector::Bench bench;
  Random random;
  std::vector<ByteFault> lidar_out, lidar_in, stage_in;  ///< For the next bytes that pass.
  std::vector<std::function<void(PtyPort::Passage&)>> stage_out;
  std::vector<WaitingFault> lidar_messages;
  /// Change every message of the lidar until they say that they are over.
  std::vector<std::function<bool(std::string& message)>> always;
  std::string previous_answer;  ///< Of the lidar, the latest that was no scan.
};

/// One fault that there is: one line of the catalogue.
struct FaultKind {
  std::string name, about;
  FaultParameters parameters;  ///< With their defaults.
  bool at_random = true;       ///< Among those that chance picks.
  std::function<void(FaultSite&, const FaultParameters&)> apply;
};

[[nodiscard]] std::vector<FaultKind> lidar_faults();
[[nodiscard]] std::vector<FaultKind> stage_faults();

/// A parameter as a number of things.
[[nodiscard]] std::size_t count_of(const FaultParameters& parameters, const std::string& name);

// What noise on a line does to bytes.

void lose_bytes(std::string& bytes, std::size_t count, Random& random);
void flip_bits(std::string& bytes, std::size_t count, Random& random);

}  // namespace sim
