// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/awaitable.hpp>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "rig/runner/lidar_link.hpp"
#include "rig/runner/observation.hpp"
#include "rig/runner/stage_motion.hpp"
#include "rig/runner/surface_echoes.hpp"
#include "rig/runner/target_detection.hpp"

namespace rig {

/// The beams that an expectation is about.
[[nodiscard]] CaptureRequest beams_of(const Expectation& expected, const fit::LidarGeometry& lidar);

/// What the rig itself sees of its bench, and which targets it still has to check: those that no prompt
/// places, those that were not in view when a prompt placed them, and all of a run that is resumed.
class BenchObserver {
 public:
  /// All are kept by reference.
  BenchObserver(const fit::Bench& bench, const std::vector<PlannedStep>& plan, const Variables& variables,
                const PlacedBench& placed, LidarLink& lidar, const StageMotion& stage)
      : bench_(bench), plan_(plan), variables_(variables), placed_(placed), lidar_(lidar), stage_(stage) {}

  /// Completes what a prompt waits to see: where the target that it places will stand.
  void expect(Prompt& prompt) const;
  /// Whether a beam can see it from here, and the stage's angle is known.
  [[nodiscard]] bool can_see(const fit::Target& target) const;

  /// Takes some scans and judges them. A lidar that is lost meanwhile is reconnected.
  boost::asio::awaitable<Observation> observe(Expectation expected);
  /// `seen`: of every beam from `first_step` on.
  [[nodiscard]] Observation judge(const Expectation& expected, int first_step, const BeamMedians& seen) const;
  /// Whether the echo follows the surface. Empty if it does.
  std::string wrong_surface(const Expectation& expected, const Observation& observed);

  void remember_unchecked();
  void check_later(Expectation expected);
  void checked(const std::string& target) { unchecked_.erase(target); }
  /// Of the unchecked ones those in view from here.
  [[nodiscard]] std::vector<Expectation> to_check_here() const;

 private:
  [[nodiscard]] Observation judge_beams(const Expectation& expected,
                                        const std::vector<double>& range_mm) const;
  [[nodiscard]] Observation judge_target(const Expectation& expected, const BeamMedians& seen) const;

  const fit::Bench& bench_;
  const std::vector<PlannedStep>& plan_;
  const Variables& variables_;
  const PlacedBench& placed_;
  LidarLink& lidar_;
  const StageMotion& stage_;
  std::map<std::string, Expectation> unchecked_;
  SurfaceEchoes surfaces_;
};

}  // namespace rig
