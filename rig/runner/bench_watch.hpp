// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/awaitable.hpp>
#include <optional>

#include "rig/runner/answer_desk.hpp"
#include "rig/runner/bench_observer.hpp"
#include "rig/runner/lidar_link.hpp"

namespace rig {

/// While a person works at the bench: shows scans, says whether they are as requested, and brings a lidar
/// back that was lost meanwhile.
class BenchWatch {
 public:
  /// All are kept by reference. Where nobody is asked nothing is shown.
  BenchWatch(const Operator& asked, const fit::LidarGeometry& geometry, RunClock& clock,
             const SessionClock& time, const BenchObserver& observer, const AnswerDesk& desk,
             LidarLink& lidar, RunStatus& status, const RunControl& control)
      : operator_(asked),
        geometry_(geometry),
        clock_(clock),
        time_(time),
        observer_(observer),
        desk_(desk),
        lidar_(lidar),
        status_(status),
        control_(control) {}

  /// Until it is called off; then the lidar may stream still.
  boost::asio::awaitable<void> watch(std::optional<Expectation> until);
  /// Stops the stream.
  boost::asio::awaitable<void> end();

 private:
  boost::asio::awaitable<void> watch_stream(std::optional<Expectation> until);
  void show(const Observation& observed);

  const Operator& operator_;
  const fit::LidarGeometry& geometry_;
  RunClock& clock_;
  const SessionClock& time_;
  const BenchObserver& observer_;
  const AnswerDesk& desk_;
  LidarLink& lidar_;
  RunStatus& status_;
  const RunControl& control_;
};

}  // namespace rig
