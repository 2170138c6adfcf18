// SPDX-License-Identifier: MIT
#include "fit/motion/deskew.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

namespace fit {
namespace {

using Eigen::Vector2d;

Path path_of_captures(const Recording& recording) {
  std::vector<TimedPose> poses;
  const auto& captures = recording.captures();
  for (std::size_t i = 0; i < captures.size(); ++i) {
    double first_s = 0, last_s = 0;
    bool any = false;
    recording.for_each_scan(i, [&](const ScanView& scan) {
      last_s = static_cast<double>(scan.host_us) * 1e-6;
      if (!any) first_s = last_s;
      any = true;
    });
    const CaptureInfo& capture = captures[i];
    const double started = static_cast<double>(capture.started_us) * 1e-6;
    // A little more on both sides: clocks may be offset.
    constexpr double margin_s = 0.1;
    for (const double t : {first_s - margin_s, last_s + 1 / recording.bench().lidar.scan_hz + margin_s})
      if (any) poses.push_back({t, {0, 0, capture.stage_rad + capture.stage_rate_rad_s * (t - started)}});
  }
  // A turn of more than half a circle between two poses needs poses in between.
  std::vector<TimedPose> dense;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (i > 0 && i % 2 == 1) {
      const TimedPose &a = poses[i - 1], &b = poses[i];
      const double turn = b.pose.heading_rad - a.pose.heading_rad;
      const int pieces = 1 + static_cast<int>(std::abs(turn));
      for (int k = 1; k < pieces; ++k) {
        const double share = static_cast<double>(k) / pieces;
        dense.push_back(
            {a.time_s + share * (b.time_s - a.time_s), {0, 0, a.pose.heading_rad + share * turn}});
      }
    }
    dense.push_back(poses[i]);
  }
  return Path(std::move(dense));
}

}  // namespace

Sweep sweep_of(const ScanView& scan, const CaptureInfo& capture, const LidarGeometry& lidar) {
  Sweep sweep;
  sweep.begin_s = static_cast<double>(scan.host_us) * 1e-6;
  const std::size_t beams = scan.range_mm.size();
  const BeamAngles angles(lidar, capture, scan.geometry);
  const double step = angles.step_rad();
  double duration = lidar.beam_time_s(static_cast<double>(capture.cluster) * static_cast<double>(beams));
  if (scan.geometry) {
    duration = scan.geometry->scan_s.value_or(std::abs(step) * static_cast<double>(beams) /
                                              (2 * pi * lidar.scan_hz));
  } else {
    sweep.begin_s += lidar.beam_time_s(capture.step_of(0));
  }
  sweep.duration_s = duration;
  sweep.points.reserve(beams);
  for (std::size_t k = 0; k < beams; ++k) {
    const double range = scan.range_mm[k];
    if (range < 20 || range > 64000) continue;
    const double angle = angles.at_rad(k);
    sweep.points.push_back({{range * std::cos(angle), range * std::sin(angle)},
                            static_cast<double>(k) / static_cast<double>(beams),
                            static_cast<std::uint32_t>(k)});
  }
  return sweep;
}

Carrier carrier_of(const Recording& recording) {
  std::vector<TimedPose> odometry, stage;
  for (const TrackPose& pose : recording.track()) {
    const double t = static_cast<double>(pose.host_us) * 1e-6;
    if (pose.x_mm && pose.y_mm && pose.heading_rad)
      odometry.push_back({t, {*pose.x_mm, *pose.y_mm, *pose.heading_rad}});
    if (pose.stage_rad) stage.push_back({t, {0, 0, *pose.stage_rad}});
  }
  if (odometry.size() >= 2) return {Path(std::move(odometry)), true};
  const bool rates = std::ranges::any_of(recording.captures(), is_turning);
  if (!rates && stage.size() >= 2) return {Path(std::move(stage)), false};
  return {path_of_captures(recording), false};
}

std::vector<Vector2d> deskew(const Sweep& sweep, const Path& path, const Pose2& lidar,
                             const SweepTiming& timing, double reference_share) {
  const Pose2 back = (path.at(timing.path_time(sweep, reference_share)) * lidar).inverse();
  std::vector<Vector2d> points;
  points.reserve(sweep.points.size());
  for (const SweptPoint& p : sweep.points)
    points.push_back(back * (path.at(timing.path_time(sweep, p.share)) * (lidar * p.at_mm)));
  return points;
}

}  // namespace fit
