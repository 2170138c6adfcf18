// SPDX-License-Identifier: MIT
#include "rig/fitting/centre_positions.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "fit/numeric/dense.hpp"
#include "rig/fitting/result_document.hpp"

namespace rig::centre_parts {
namespace {

using Samples = std::vector<fit::Sample>;

/// The samples of some beams in one capture, by lidar step.
std::map<int, Samples> samples_of(const fit::Recording& recording, std::size_t index, int from_step,
                                  int to_step) {
  const fit::CaptureInfo& capture = recording.captures()[index];
  std::map<int, Samples> out;
  recording.for_each_scan(index, [&](const fit::ScanView& scan) {
    for (std::size_t k = 0; k < scan.range_mm.size(); ++k) {
      const int step = capture.first_step + static_cast<int>(k) * capture.cluster;
      if (step < from_step || step > to_step) continue;
      out[step].push_back(
          {scan.range_mm[k], k < scan.intensity.size() ? scan.intensity[k] : std::uint16_t{0}});
    }
  });
  return out;
}

/// The stop with most samples on the target alone; of equals the one nearest to the edge.
const fit::EdgeStop* best_smooth_stop(const fit::EdgeCrossing& crossing) {
  const fit::EdgeStop* best = nullptr;
  const auto distance = [&](const fit::EdgeStop& stop) {
    return std::abs(stop.stage_rad - crossing.response.edge_rad.value);
  };
  for (const fit::EdgeStop& stop : crossing.stops) {
    if (stop.state != fit::EdgeStop::State::front || distance(stop) > 0.5 * fit::rad_per_deg) continue;
    if (!best || stop.n > best->n || (stop.n == best->n && distance(stop) < distance(*best))) best = &stop;
  }
  return best;
}

/// How the range changes along the target, from the beams next to the edge; mm per radian of beam angle.
double slope_of(const std::map<int, Samples>& beams, const fit::LidarGeometry& lidar, double near_mm) {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0;
  for (const auto& [step, samples] : beams) {
    const fit::SelectedMean mean = fit::select_robust(samples);
    if (mean.kept < 10 || std::abs(mean.mean_mm - near_mm) > 60) continue;
    const double a = lidar.beam_angle(step);
    n += 1, x += a, y += mean.mean_mm, xx += a * a, xy += a * mean.mean_mm;
  }
  const double spread = n * xx - x * x;
  return n >= 3 && spread > 0 ? (n * xy - x * y) / spread : 0;
}

/// Samples carry the mean of a run of scans: with 10 or more, correlation is measured and the mean is robust.
Position position_of(const SourcedCrossing& sourced, const fit::EdgeStop& stop) {
  const fit::EdgeCrossing& crossing = sourced.crossing;
  const fit::LidarGeometry& lidar = sourced.recording->bench().lidar;
  const int inward = crossing.right ? 1 : -1, reach = 6 * inward;
  const auto beams =
      samples_of(*sourced.recording, stop.capture, std::min(crossing.step, crossing.step + reach),
                 std::max(crossing.step, crossing.step + reach));
  Position position;
  position.capture = stop.capture;
  position.source = &sourced;
  position.robust = fit::select_robust(beams.at(crossing.step));
  position.paper = fit::select_most_frequent(beams.at(crossing.step));
  const double slope = slope_of(beams, lidar, position.robust.mean_mm);
  const double inside_rad = stop.stage_rad - crossing.response.edge_rad.value;
  position.point.stage_rad = crossing.response.edge_rad.value;
  position.point.beam_rad = crossing.beam_rad;
  position.point.range_mm = position.robust.mean_mm - slope * inside_rad;
  position.point.u_range_mm = std::hypot(position.robust.u_mm, slope * crossing.response.edge_rad.u);
  position.u_edge_rad = crossing.response.edge_rad.u;
  position.u_resolution_rad = u_of_resolution(sourced.recording->bench().stage_resolution_rad);
  position.paper_point = position.point;
  position.paper_point.stage_rad = stop.stage_rad;
  position.paper_point.range_mm = position.paper.mean_mm;
  position.paper_point.u_range_mm = position.paper.u_mm;
  // The paper's point lies anywhere within one step of the stage from the end of the window.
  position.paper_point.u_angle_rad = std::max(crossing.step_rad / std::sqrt(12.0), 1e-7);
  return position;
}

}  // namespace

std::vector<Position> positions_of(const EdgeSource& source, bool right, double worst_rad) {
  std::vector<Position> positions;
  for (const SourcedCrossing& sourced : source.crossings) {
    if (sourced.crossing.right != right || sourced.crossing.response.edge_rad.u > worst_rad) continue;
    const fit::EdgeStop* stop = best_smooth_stop(sourced.crossing);
    if (!stop) continue;
    const auto same_place = std::ranges::find_if(positions, [&](const Position& position) {
      return position.source->recording == sourced.recording &&
             std::abs(position.point.stage_rad - sourced.crossing.response.edge_rad.value) <
                 5 * fit::rad_per_deg;
    });
    if (same_place == positions.end())
      positions.push_back(position_of(sourced, *stop));
    else if (same_place->robust.samples < stop->n)
      *same_place = position_of(sourced, *stop);
  }
  const auto order = [&](const Position& position) {
    const auto is_its = [&](const auto& recording) { return recording.get() == position.source->recording; };
    return std::pair(std::ranges::find_if(source.recordings, is_its) - source.recordings.begin(),
                     position.capture);
  };
  std::ranges::sort(positions, {}, order);
  return positions;
}

CommonEffects effects_on(const std::vector<Position>& positions, const fit::DeviceAccuracy& accuracy) {
  CommonEffects out;
  // `move`: radially and tangentially, for one standard uncertainty.
  const auto add = [&](fit::Systematic fit::DeviceAccuracy::*member, const auto& move) {
    if ((accuracy.*member).u <= 0) return;
    fit::CentreEffect effect;
    for (const Position& position : positions)
      effect.shift_mm.push_back(move(position, (accuracy.*member).u));
    for (const fit::AccuracyLine& line : fit::accuracy_in_words(accuracy))
      if (line.member == member) out.lines.push_back(line), effect.name = line.name;
    out.effects.push_back(std::move(effect));
  };
  const auto turned = [](const Position& position, double rad) {
    return Eigen::Vector2d(0, position.point.range_mm * rad);
  };
  using fit::DeviceAccuracy;
  add(&DeviceAccuracy::stage_scale,
      [&](const Position& p, double u) { return turned(p, u * p.point.stage_rad); });
  add(&DeviceAccuracy::stage_backlash_rad,
      [&](const Position& p, double u) { return turned(p, u / 2 * p.source->crossing.approach); });
  // An amplitude of unknown phase: a sine and a cosine, each with half of its variance.
  for (const bool sine : {true, false}) {
    const auto wave = [sine](double rad) { return (sine ? std::sin(rad) : std::cos(rad)) / std::sqrt(2.0); };
    add(&DeviceAccuracy::stage_eccentricity_rad,
        [&](const Position& p, double u) { return turned(p, u * wave(p.point.stage_rad)); });
    add(&DeviceAccuracy::beam_eccentricity_rad,
        [&](const Position& p, double u) { return turned(p, u * wave(p.point.beam_rad)); });
  }
  add(&DeviceAccuracy::range_offset_mm, [](const Position&, double u) { return Eigen::Vector2d(u, 0); });
  add(&DeviceAccuracy::range_scale,
      [](const Position& p, double u) { return Eigen::Vector2d(u * p.point.range_mm, 0); });
  for (int curve = 0; curve < fit::walk_curves; ++curve)
    add(&DeviceAccuracy::range_walk_mm, [curve](const Position& p, double u) {
      return Eigen::Vector2d(
          u / std::sqrt(double{fit::walk_curves}) * fit::walk_curve(curve, p.robust.intensity), 0);
    });
  return out;
}

fit::BoardLine line_through(const std::vector<BoardPoint>& seen, double stage_rad,
                            const std::function<double(double beam_rad)>& bend) {
  std::vector<Eigen::Vector2d> points;
  double variance = 0;
  for (const BoardPoint& beam : seen) {
    const double a = beam.beam_rad + bend(beam.beam_rad);
    points.emplace_back(beam.range_mm * std::cos(a), beam.range_mm * std::sin(a));
    variance += beam.u_mm * beam.u_mm;
  }
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const auto& point : points) mean += point / static_cast<double>(points.size());
  Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
  for (const auto& point : points) scatter += (point - mean) * (point - mean).transpose();
  const fit::dense::SymmetricEigen axes = fit::dense::symmetric_eigen(scatter);
  Eigen::Vector2d normal = axes.vectors.col(0);
  if (normal.dot(mean) < 0) normal = -normal;
  const double n = static_cast<double>(points.size()), rms = std::sqrt(axes.values[0] / (n - 2));
  // The distance is that of the foot of the perpendicular, which may lie outside the points.
  const double lever = std::abs(Eigen::Vector2d(-normal.y(), normal.x()).dot(mean));
  const double u_mean = std::max(rms, std::sqrt(variance / n)) / std::sqrt(n);
  const double u_tilt = u_mean * std::sqrt(n / axes.values[1]) * lever;
  return {stage_rad, std::atan2(normal.y(), normal.x()), normal.dot(mean), std::hypot(u_mean, u_tilt),
          static_cast<long>(points.size())};
}

std::vector<BoardPoint> board_seen(const Position& position) {
  const fit::EdgeCrossing& crossing = position.source->crossing;
  const fit::Recording& recording = *position.source->recording;
  const fit::LidarGeometry& lidar = recording.bench().lidar;
  const int inward = crossing.right ? 1 : -1;
  const auto beams = samples_of(recording, position.capture, 0, lidar.steps);
  std::vector<BoardPoint> seen;
  double previous = position.robust.mean_mm;
  for (int step = crossing.step + inward; beams.contains(step); step += inward) {
    const fit::SelectedMean mean = fit::select_robust(beams.at(step));
    if (mean.kept < 10 || std::abs(mean.mean_mm - previous) > 40) break;
    previous = mean.mean_mm;
    seen.push_back({lidar.beam_angle(step), mean.mean_mm, mean.u_mm});
  }
  if (seen.size() < 44) return {};
  seen.resize(seen.size() - 4);  // The far end may be an edge as well.
  return seen;
}

}  // namespace rig::centre_parts
