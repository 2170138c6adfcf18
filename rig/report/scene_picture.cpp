// SPDX-License-Identifier: MIT
#include "rig/report/scene_picture.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <utility>
#include <vector>

namespace rig {
namespace {

/// The mean echo of every beam of a capture, from its first hundred scans.
Series mean_echoes(const fit::Recording& recording, std::size_t index) {
  const fit::CaptureInfo& capture = recording.captures()[index];
  const fit::Bench& bench = recording.bench();
  std::vector<double> sum, count, angle;
  int scans = 0;
  recording.for_each_scan(index, [&](const fit::ScanView& scan) {
    if (scans++ > 100) return;
    sum.resize(std::max(sum.size(), scan.range_mm.size()));
    count.resize(sum.size());
    angle.resize(sum.size());
    const fit::BeamAngles angles(bench.lidar, capture, scan.geometry);
    for (std::size_t i = 0; i < scan.range_mm.size(); ++i) {
      angle[i] = angles.at_rad(i);
      if (scan.range_mm[i] == 0) continue;
      sum[i] += scan.range_mm[i];
      count[i] += 1;
    }
  });
  const double theta = capture.stage_rad, yaw = bench.lidar.mount.yaw_rad.value;
  const double mx = bench.lidar.mount.x_mm.value, my = bench.lidar.mount.y_mm.value;
  const double ox = std::cos(theta) * mx - std::sin(theta) * my,
               oy = std::sin(theta) * mx + std::cos(theta) * my;
  Series echoes{"mean echo of each beam", Series::Style::points, {}, {}, {}};
  for (std::size_t i = 0; i < sum.size(); ++i) {
    if (count[i] == 0) continue;
    const double direction = theta + yaw + angle[i], range = sum[i] / count[i];
    echoes.x.push_back(ox + range * std::cos(direction));
    echoes.y.push_back(oy + range * std::sin(direction));
  }
  return echoes;
}

}  // namespace

ScenePicture scene_picture(const fit::Recording& recording) {
  ScenePicture picture{{"", "x (mm)", "y (mm)", {}}, ""};
  Plot& plot = picture.plot;
  plot.equal_axes = true;
  plot.height_px = 440;
  const auto& captures = recording.captures();
  std::size_t widest = captures.size();
  for (std::size_t i = 0; i < captures.size(); ++i)
    if (widest == captures.size() || captures[i].beams() > captures[widest].beams()) widest = i;
  if (widest == captures.size()) return picture;
  const fit::CaptureInfo& capture = captures[widest];
  const fit::Bench& bench = recording.bench();
  const double theta = capture.stage_rad;
  Series echoes = mean_echoes(recording, widest);
  for (const fit::Target& target : bench.targets) {
    const Eigen::Vector2d shift = capture.target == target.name
                                      ? Eigen::Vector2d(target.outward_normal() * capture.target_shift_mm)
                                      : Eigen::Vector2d::Zero();
    plot.series.push_back({target.name + " (bench file)",
                           Series::Style::line,
                           {target.from_mm.x() + shift.x(), target.to_mm.x() + shift.x()},
                           {target.from_mm.y() + shift.y(), target.to_mm.y() + shift.y()},
                           {}});
  }
  plot.series.push_back(std::move(echoes));
  plot.series.push_back({"stage axis", Series::Style::points, {0}, {0}, {}});
  std::array<char, 40> stage{};
  std::snprintf(stage.data(), stage.size(), "%.2f deg", theta * fit::deg_per_rad);
  picture.caption = "The scene in the world frame: capture " + std::to_string(capture.id) +
                    " at stage angle " + stage.data() + ", beside the bench file's targets.";
  return picture;
}

}  // namespace rig
