// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/awaitable.hpp>
#include <functional>
#include <string>
#include <vector>

#include "fit/bench/bench.hpp"
#include "rig/runner/lidar_source.hpp"
#include "rig/runner/runner.hpp"
#include "rig/stage/stage.hpp"

namespace rig {

/// One thing that was looked at before a long run.
struct CheckLine {
  enum class Verdict { good, note, bad };
  CheckLine(Verdict verdict_, std::string what_, std::string says_, std::string remedy_ = "")
      : verdict(verdict_), what(std::move(what_)), says(std::move(says_)), remedy(std::move(remedy_)) {}
  Verdict verdict;
  std::string what, says;
  std::string remedy;  ///< What to do; empty when all is well.
};

/// Walks through the bench: the lidar's rate and losses, homing and the stage's full travel (unless
/// `stay_still`), echoes and intensity, and every target where the bench file says. Each line is reported as
/// soon as it is known. Throws DeviceError when a device does not work at all.
boost::asio::awaitable<std::vector<CheckLine>> check_bench(const fit::Bench& bench, LidarSource& lidar,
                                                           Stage& stage, RunClock& clock, bool stay_still,
                                                           std::function<void(const CheckLine&)> report);

}  // namespace rig
