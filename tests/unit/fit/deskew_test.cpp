// SPDX-License-Identifier: MIT
#include "fit/motion/deskew.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <random>

#include "fit/motion/map_fusion.hpp"
#include "fit/motion/sweep_timing.hpp"
#include "synthetic_recording.hpp"
#include "tests/support/moving_room.hpp"

namespace deskew_test {
namespace {

using Eigen::Vector2d;
using fit::Pose2;
using room::deg;

/// A lidar 80 mm off the axis of a stage that turns there and back with at most 40 deg/s.
struct TurningStage {
  double rate = 40 * deg;  ///< Greatest.
  double from = 0;         ///< Where it is at time 0.
  bool there_and_back = false;
  double sigma_mm = 5;
  const Pose2 mount{80, 20, 0.1};
  std::vector<room::Wall> walls = room::furnished();

  [[nodiscard]] double angle(double t) const {
    constexpr double period = 3;
    return there_and_back
               ? rate * period / (2 * std::numbers::pi) * std::sin(2 * std::numbers::pi * t / period)
               : from + rate * t;
  }
  [[nodiscard]] room::Pose lidar(double t) const {
    const double a = angle(t);
    return {std::cos(a) * mount.x_mm - std::sin(a) * mount.y_mm,
            std::sin(a) * mount.x_mm + std::cos(a) * mount.y_mm, a + mount.heading_rad};
  }
  /// Scans as the recordings hold them, 25 ms apart from 0.5 s on.
  [[nodiscard]] std::vector<fit::Sweep> sweeps(int count, unsigned seed) const {
    std::mt19937 random(seed);
    fit::LidarGeometry geometry;
    fit::CaptureInfo capture;
    capture.last_step = 1080;
    std::vector<fit::Sweep> out;
    for (int i = 0; i < count; ++i) {
      fit::ScanView view;
      view.host_us = 500'000 + 25'000 * i;
      const auto ranges = room::scan(
          walls, [this](double t) { return lidar(t); }, 0.5 + 0.025 * i, sigma_mm, random);
      view.range_mm = ranges;
      out.push_back(fit::sweep_of(view, capture, geometry));
    }
    return out;
  }
  /// What odometry says: the angle times `gain`, told `late_s` after it was true, every 20 ms.
  [[nodiscard]] fit::Path path(double seconds, double gain = 1, double late_s = 0) const {
    std::vector<fit::TimedPose> poses;
    for (double t = 0; t < seconds + 1; t += 0.02) poses.push_back({t, {0, 0, gain * angle(t - late_s)}});
    return fit::Path(poses);
  }
};

std::vector<room::Point> plain(const std::vector<Vector2d>& points) {
  std::vector<room::Point> out;
  for (const Vector2d& p : points) out.push_back({p.x(), p.y()});
  return out;
}

struct Residuals {
  double within_scan = 0;  ///< After the best rigid placing of each scan: distortion and noise.
  double map = 0;          ///< After the best rigid placing of the whole map, whose frame is its own.
};

/// Judges every tenth scan by itself, and all of them together.
Residuals judge(const TurningStage& stage, const std::vector<std::vector<Vector2d>>& placed_scans) {
  Residuals out;
  double sum = 0;
  int count = 0;
  std::vector<Vector2d> all;
  for (std::size_t i = 0; i < placed_scans.size(); i += 10) {
    std::vector<Vector2d> thinned;
    for (std::size_t k = 0; k < placed_scans[i].size(); k += 3) thinned.push_back(placed_scans[i][k]);
    const double d = room::rms_at_best(stage.walls, plain(thinned));
    sum += d * d;
    for (std::size_t k = 0; k < thinned.size(); k += 3) all.push_back(thinned[k]);
    ++count;
  }
  out.within_scan = std::sqrt(sum / count);
  out.map = room::rms_at_best(stage.walls, plain(all));
  return out;
}

Residuals by_odometry(const TurningStage& stage, const std::vector<fit::Sweep>& sweeps, const fit::Path& path,
                      const fit::SweepTiming& timing = {}) {
  std::vector<std::vector<Vector2d>> scans;
  for (const auto& sweep : sweeps) {
    const Pose2 begin = path.at(sweep.begin_s + timing.offset_s) * stage.mount;
    scans.emplace_back();
    for (const Vector2d& p : fit::deskew(sweep, path, stage.mount, timing)) scans.back().push_back(begin * p);
  }
  return judge(stage, scans);
}

Residuals not_corrected(const TurningStage& stage, const std::vector<fit::Sweep>& sweeps,
                        const fit::Path& path) {
  std::vector<std::vector<Vector2d>> scans;
  for (const auto& sweep : sweeps) {
    const Pose2 begin = path.at(sweep.begin_s) * stage.mount;
    scans.emplace_back();
    for (const auto& p : sweep.points) scans.back().push_back(begin * p.at_mm);
  }
  return judge(stage, scans);
}

Residuals by_fusion(const TurningStage& stage, const std::vector<fit::Sweep>& sweeps, const fit::Path& path) {
  fit::Fusion fusion(path, stage.mount);
  std::vector<std::vector<Vector2d>> scans;
  for (const auto& sweep : sweeps) scans.push_back(fusion.add(sweep).map_mm);
  return judge(stage, scans);
}

}  // namespace

TEST_CASE("after deskewing, a lidar turning at 40 deg/s is as sharp as one that stands") {
  TurningStage turning, standing;
  standing.rate = 0;
  const auto sweeps = turning.sweeps(120, 1);
  const double still = by_odometry(standing, standing.sweeps(120, 2), standing.path(4)).within_scan;
  const double before = not_corrected(turning, sweeps, turning.path(4)).within_scan;
  const Residuals odometry = by_odometry(turning, sweeps, turning.path(4));
  const Residuals fused = by_fusion(turning, sweeps, turning.path(4));
  CAPTURE(still, before, odometry.within_scan, odometry.map, fused.within_scan, fused.map);
  CHECK(before > 1.2 * still);
  CHECK(odometry.within_scan < 1.2 * still);
  CHECK(fused.within_scan < 1.2 * still);
  CHECK(fused.within_scan < 1.02 * odometry.within_scan);
  CHECK(fused.map < 1.2 * still);
  WARN("RMS from the walls (mm): standing "
       << still << ", turning at 40 deg/s " << before << ", by stage track " << odometry.within_scan
       << ", fused " << fused.within_scan << " (map " << odometry.map << ", " << fused.map << ")");
}

TEST_CASE("fusion corrects odometry that is 5 percent wrong") {
  TurningStage stage;
  const auto sweeps = stage.sweeps(120, 3);
  const fit::Path wrong = stage.path(4, 1.05);
  const Residuals odometry = by_odometry(stage, sweeps, wrong), fused = by_fusion(stage, sweeps, wrong);
  CAPTURE(odometry.within_scan, odometry.map, fused.within_scan, fused.map);
  CHECK(fused.within_scan < odometry.within_scan);
  CHECK(fused.map < 0.5 * odometry.map);
  CHECK(fused.map < 1.5 * stage.sigma_mm);
  WARN("odometry 5 % wrong, RMS (mm): odometry " << odometry.within_scan << " map " << odometry.map
                                                 << ", fused " << fused.within_scan << " map " << fused.map);
}

TEST_CASE("fusion corrects odometry that comes 30 ms late, and its lateness is found") {
  TurningStage stage;
  stage.there_and_back = true;
  const auto sweeps = stage.sweeps(160, 4);
  const fit::Path late = stage.path(5, 1, 0.03);
  const Residuals odometry = by_odometry(stage, sweeps, late), fused = by_fusion(stage, sweeps, late);
  CAPTURE(odometry.within_scan, odometry.map, fused.within_scan, fused.map);
  CHECK(fused.map < 0.5 * odometry.map);
  CHECK(fused.within_scan < 1.02 * odometry.within_scan);
  const auto found = fit::estimate_timing(sweeps, late, stage.mount, {0.1, std::nullopt, true});
  CAPTURE(found.timing.offset_s, found.offset_s.u);
  CHECK(found.determined);
  CHECK_FALSE(found.timing.reversed);
  CHECK(found.timing.offset_s == Approx(0.03).margin(0.003));
  CHECK(std::abs(found.timing.offset_s - 0.03) < 3 * found.offset_s.u + 0.001);
  const Residuals timed = by_odometry(stage, sweeps, late, found.timing);
  CHECK(timed.map < 1.2 * stage.sigma_mm);
  WARN("odometry 30 ms late, RMS (mm): odometry "
       << odometry.within_scan << " map " << odometry.map << ", fused " << fused.within_scan << " map "
       << fused.map << ", odometry with the offset found (" << 1e3 * found.timing.offset_s << " +/- "
       << 1e3 * found.offset_s.u << " ms) map " << timed.map);
}

TEST_CASE("beams listed against their order in time are noticed") {
  TurningStage stage;
  stage.there_and_back = true;
  auto sweeps = stage.sweeps(100, 5);
  for (auto& sweep : sweeps)  // as a driver does that lists a clockwise lidar's beams counter-clockwise
    for (auto& p : sweep.points) p = {{p.at_mm.x(), p.at_mm.y()}, 1 - p.share, p.beam};
  const auto found = fit::estimate_timing(sweeps, stage.path(4), stage.mount, {0.1, std::nullopt, true});
  CHECK(found.timing.reversed);
}

TEST_CASE("captures of a stage that turned both ways at even rates tell offset and order together") {
  TurningStage there, back;
  there.sigma_mm = back.sigma_mm = 8;
  back.rate = -there.rate;
  back.from = 100 * deg;
  auto sweeps = there.sweeps(60, 7);
  for (auto sweep : back.sweeps(60, 8)) {
    sweep.begin_s += 10;
    sweeps.push_back(sweep);
  }
  // The stage's readings are 12 ms late.
  std::vector<fit::TimedPose> poses;
  for (const auto& [stage, begin] : {std::pair{there, 0.0}, std::pair{back, 10.0}})
    for (const double t : {0.0, 1.0, 2.0, 3.0}) poses.push_back({begin + t, {0, 0, stage.angle(t - 0.012)}});
  const auto found = fit::estimate_timing(sweeps, fit::Path(poses), there.mount, {0.1, std::nullopt, false});
  CAPTURE(found.timing.offset_s, found.offset_s.u);
  CHECK(found.determined);
  CHECK_FALSE(found.timing.reversed);
  CHECK(found.timing.offset_s == Approx(0.012).margin(0.0015));
}

TEST_CASE("a stage's captures tell where it was, also where its track does not reach") {
  SyntheticRecording recording({},
                               [](const fit::CaptureInfo&, std::int64_t, std::vector<std::uint16_t>& range,
                                  std::vector<std::uint16_t>&) { std::ranges::fill(range, 1000); });
  fit::CaptureInfo capture;
  capture.last_step = 3;
  capture.stage_rad = 0.7;
  capture.stage_rate_rad_s = 0.5;
  recording.add(capture, 40);
  const fit::Carrier carrier = fit::carrier_of(recording);
  CHECK_FALSE(carrier.drifts);
  for (const double t : {-0.05, 0.0, 0.4, 0.975, 1.05})
    CHECK(carrier.path.at(t).heading_rad == Approx(0.7 + 0.5 * t));
}

TEST_CASE("a path follows a curve through its poses and turns through the shorter arc") {
  std::vector<fit::TimedPose> poses;
  for (int i = 0; i <= 20; ++i) {
    const double a = 0.1 * i + 3;  // passes the half turn
    poses.push_back({0.1 * i, {1000 * std::cos(a), 1000 * std::sin(a), fit::wrap_angle(a)}});
  }
  const fit::Path path(poses);
  for (double t = 0; t <= 2; t += 0.013) {
    const Pose2 at = path.at(t);
    const double a = t + 3;
    CHECK(std::hypot(at.x_mm - 1000 * std::cos(a), at.y_mm - 1000 * std::sin(a)) <
          1.3);  // sagitta of 0.1 rad
    CHECK(std::abs(fit::wrap_angle(at.heading_rad - a)) < 1e-9);
  }
}

TEST_CASE("deskewing into the end of a scan is deskewing into its start, seen from the end") {
  TurningStage stage;
  const auto sweeps = stage.sweeps(1, 6);
  const fit::Path path = stage.path(2);
  const auto start = fit::deskew(sweeps[0], path, stage.mount, {}, 0),
             end = fit::deskew(sweeps[0], path, stage.mount, {}, 1);
  const Pose2 a = path.at(sweeps[0].begin_s) * stage.mount, b = path.at(sweeps[0].time_s(1)) * stage.mount;
  for (std::size_t i = 0; i < start.size(); ++i) CHECK((a * start[i] - b * end[i]).norm() < 1e-6);
}

}  // namespace deskew_test
