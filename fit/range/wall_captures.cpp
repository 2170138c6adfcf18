// SPDX-License-Identifier: MIT
// Captures for fit_wall(): means of beams, lines in them, and which wall each beam sees.
#include <algorithm>
#include <iterator>
#include <stdexcept>

#include "fit/numeric/angle.hpp"
#include "fit/numeric/median.hpp"
#include "fit/range/wall_parts.hpp"

namespace fit::wall_parts {
namespace {

using Eigen::Vector2d;

/// Mean of the samples near their median: what passes by now and then does not count.
void set_mean(WallBeam& beam, std::vector<double>& samples) {
  if (samples.empty()) return;
  const double middle = median_of(samples);
  std::vector<double> deviations;
  for (const double value : samples) deviations.push_back(std::abs(value - middle));
  const double gate = std::max(5.0, 5 * 1.4826 * median_of(deviations));
  double sum = 0;
  for (const double value : samples) {
    if (std::abs(value - middle) > gate) continue;
    sum += value;
    ++beam.scans;
  }
  beam.range = sum / beam.scans;
}

/// Lines in a station, longest first, with the beams on them.
struct DetectedLine {
  LineFit fit;
  std::vector<std::size_t> beams;
};

std::vector<DetectedLine> lines_of(const Station& station, double tolerance) {
  std::vector<std::size_t> left;
  for (std::size_t k = 0; k < station.beams.size(); ++k)
    if (station.beams[k].scans > 0) left.push_back(k);
  std::vector<DetectedLine> lines;
  RansacOptions options;
  options.tolerance = tolerance;
  while (lines.size() < 6 && left.size() >= 20) {
    std::vector<Vector2d> points;
    for (const std::size_t k : left) points.push_back(station.beams[k].point());
    const auto found = find_line(points, options);
    if (!found || found->inliers.size() < 20) break;
    DetectedLine line{found->fit, {}};
    for (const std::size_t i : found->inliers) line.beams.push_back(left[i]);
    std::vector<std::size_t> rest;
    std::set_difference(left.begin(), left.end(), line.beams.begin(), line.beams.end(),
                        std::back_inserter(rest));
    left = std::move(rest);
    lines.push_back(std::move(line));
  }
  return lines;
}

/// Beams at the ends of a run may see an edge or the corner.
std::vector<std::size_t> without_ends(const std::vector<std::size_t>& beams, std::size_t ends = 3) {
  std::vector<std::size_t> kept;
  for (std::size_t first = 0; first < beams.size();) {
    std::size_t last = first;
    while (last + 1 < beams.size() && beams[last + 1] <= beams[last] + 2) ++last;
    for (std::size_t i = first + ends; i + ends <= last; ++i) kept.push_back(beams[i]);
    first = last + 1;
  }
  return kept;
}

WallInBench in_bench(const Target& target) {
  const Vector2d n = target.outward_normal();
  return {target.name, {std::atan2(n.y(), n.x()), n.dot(target.from_mm)}, target.u_rad};
}

/// Without boards in the bench: the two longest square lines of the station nearest to stage angle 0, taken
/// to stand parallel and square to the stage's zero (the patent's premise).
void walls_from(const Station& station, double yaw, WallInBench* walls) {
  const auto lines = lines_of(station, 20);
  const auto place = [&](const DetectedLine& line) {
    const double normal = line.fit.line.normal_rad + station.stage_rad + yaw;
    return Line2{std::round(normal / (pi / 2)) * (pi / 2), line.fit.line.distance_mm};
  };
  for (std::size_t a = 0; a < lines.size(); ++a)
    for (std::size_t b = a + 1; b < lines.size(); ++b) {
      const Line2 first = place(lines[a]), second = place(lines[b]);
      if (std::abs(std::cos(first.normal_rad - second.normal_rad)) > 0.1) continue;
      const bool swap = std::abs(wrap_angle(second.normal_rad)) < std::abs(wrap_angle(first.normal_rad));
      walls[0] = {"front wall", swap ? second : first, 0};
      walls[1] = {"side wall", swap ? first : second, 0};
      return;
    }
  throw std::invalid_argument(
      "The bench names no two boards at a right angle, and none were found in the scan nearest to stage "
      "angle 0. "
      "Add both boards to the bench file, or name them with the options front and side");
}

}  // namespace

Station read_station(const Recording& recording, std::size_t index, std::size_t most_scans) {
  const CaptureInfo& capture = recording.captures()[index];
  const LidarGeometry& lidar = recording.bench().lidar;
  Station station;
  station.stage_rad = capture.stage_readback_rad.value_or(capture.stage_rad);
  station.approach = capture.approach;
  std::vector<std::vector<double>> samples;
  std::vector<double> counts, echoes;
  recording.for_each_scan(index, [&](const ScanView& scan) {
    if (scan.geometry) return;  // Scans whose beams differ cannot be averaged beam by beam.
    samples.resize(std::max(samples.size(), scan.range_mm.size()));
    counts.resize(samples.size()), echoes.resize(samples.size());
    for (std::size_t k = 0; k < scan.range_mm.size(); ++k) {
      if (scan.range_mm[k] < 20) continue;
      samples[k].push_back(scan.range_mm[k]);
      if (k < scan.intensity.size()) counts[k] += scan.intensity[k], echoes[k] += 1;
    }
    if (station.scans.size() < most_scans)
      station.scans.emplace_back(scan.range_mm.begin(), scan.range_mm.end());
  });
  station.beams.resize(samples.size());
  for (std::size_t k = 0; k < samples.size(); ++k) {
    station.beams[k].angle = lidar.beam_angle(capture.step_of(static_cast<int>(k)));
    set_mean(station.beams[k], samples[k]);
    if (echoes[k] > 0) station.beams[k].counts = counts[k] / echoes[k];
  }
  return station;
}

void assign(Station& station, const WallInBench* walls, double yaw, const WallOptions& options) {
  for (const DetectedLine& line : lines_of(station, options.tolerance_mm)) {
    for (int j = 0; j < 2; ++j) {
      const double expected = walls[j].line.normal_rad - station.stage_rad - yaw;
      if (std::abs(wrap_angle(line.fit.line.normal_rad - expected)) > 15 * rad_per_deg) continue;
      if (std::abs(line.fit.line.distance_mm - walls[j].line.distance_mm) > 400) continue;
      const bool taken = std::ranges::any_of(station.beams, [j](const WallBeam& b) { return b.wall == j; });
      if (taken) continue;
      for (const std::size_t k : without_ends(line.beams)) station.beams[k].wall = j;
    }
  }
}

void find_walls(const Bench& bench, const Station& nearest_zero, const WallOptions& options, WallFit& fit) {
  std::vector<const Target*> boards;
  for (const std::string& name : {options.front, options.side}) {
    if (name.empty()) continue;
    const Target* target = bench.target(name);
    if (!target) throw std::invalid_argument("The bench has no board named " + name);
    boards.push_back(target);
  }
  for (const Target& target : bench.targets) {
    if (boards.size() >= 2) break;
    if (std::ranges::find(boards, &target) != boards.end()) continue;
    const bool square =
        boards.empty() || std::abs(boards[0]->outward_normal().dot(target.outward_normal())) < 0.2;
    if (square) boards.push_back(&target);
  }
  if (boards.size() < 2) {
    walls_from(nearest_zero, bench.lidar.mount.yaw_rad.value, fit.walls);
    fit.notes.push_back(
        "The bench names no two boards at a right angle: the two longest walls at stage angle 0 were taken "
        "to "
        "stand parallel and square to the stage's zero.");
    return;
  }
  for (int j = 0; j < 2; ++j) fit.walls[j] = in_bench(*boards[static_cast<std::size_t>(j)]);
}

}  // namespace fit::wall_parts
