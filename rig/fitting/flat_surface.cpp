// SPDX-License-Identifier: MIT
#include "rig/fitting/flat_surface.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <map>

#include "fit/numeric/angle.hpp"
#include "fit/numeric/number_format.hpp"
#include "fit/range/selection.hpp"
#include "rig/session/step_in_words.hpp"

namespace rig {
namespace {

using Eigen::Vector2d;

}  // namespace

Vector2d point_of(const MeanBeam& beam, double range_mm) {
  return {range_mm * std::cos(beam.direction_rad), range_mm * std::sin(beam.direction_rad)};
}

std::optional<FlatSurface> surface_of(const fit::Recording& recording, std::size_t index,
                                      const std::string& wanted, const fit::Mount& mount) {
  const fit::CaptureInfo& capture = recording.captures()[index];
  const fit::Bench& bench = recording.bench();
  const std::string name = wanted.empty() ? capture.target.value_or("") : wanted;
  const fit::Target* target = bench.target(name);
  if (!target || fit::is_turning(capture) || (capture.target && *capture.target != name)) return std::nullopt;
  const double stage = capture.stage_readback_rad.value_or(capture.stage_rad);
  const Vector2d origin = Eigen::Rotation2Dd(stage) * Vector2d(mount.x_mm.value, mount.y_mm.value);
  const Eigen::Rotation2Dd to_lidar(-stage - mount.yaw_rad.value);
  const Vector2d shift = target->outward_normal() * capture.target_shift_mm;
  const Vector2d from = to_lidar * (target->from_mm + shift - origin),
                 to = to_lidar * (target->to_mm + shift - origin);
  FlatSurface out;
  out.label = capture.step.empty() ? std::to_string(capture.id) : step_in_words(capture.step);
  // Outside a loop a step has no words of its own.
  if (capture.step.find('[') == std::string::npos)
    out.label += ", " + target->name + ", stage " +
                 fit::format_value(capture.stage_rad * fit::deg_per_rad, 0) + " deg";
  out.stage_rad = stage;
  out.temperature_c = capture.temperature_c;
  out.normal = to_lidar * target->outward_normal();
  const double distance = out.normal.dot(from);
  std::map<std::size_t, std::vector<fit::Sample>> samples;
  recording.for_each_scan(index, [&](const fit::ScanView& scan) {
    if (scan.geometry) return;
    const fit::BeamAngles angles(bench.lidar, capture, scan.geometry);
    for (std::size_t k = 0; k < scan.range_mm.size(); ++k) {
      const double direction = angles.at_rad(k);
      const Vector2d ray(std::cos(direction), std::sin(direction));
      const double facing = ray.dot(out.normal);
      if (facing < 0.1) continue;
      const Vector2d at = ray * (distance / facing), along = to - from;
      const double place = (at - from).dot(along) / along.squaredNorm();
      if (place < 0.03 || place > 0.97) continue;
      samples[k].push_back(
          {scan.range_mm[k], k < scan.intensity.size() ? scan.intensity[k] : std::uint16_t{0}});
    }
  });
  const std::optional<fit::ScanGeometry> none;  // Scans with a geometry of their own were left out.
  const fit::BeamAngles angles(bench.lidar, capture, none);
  for (const auto& [k, of_beam] : samples) {
    const fit::SelectedMean mean = fit::select_robust(of_beam);
    const double direction = angles.at_rad(k);
    if (mean.kept < 1 ||
        std::abs(point_of({direction, 0, 0}, mean.mean_mm).dot(out.normal) - distance) > 0.1 * distance + 60)
      continue;
    out.beams.push_back({direction, mean.mean_mm, mean.intensity});
  }
  return out.beams.empty() ? std::nullopt : std::optional(out);
}

std::vector<Vector2d> surface_points(const FlatSurface& surface, const fit::Correction* correction) {
  // The ordinate of the paper lies across the surface.
  const Eigen::Rotation2Dd upright(fit::pi / 2 - std::atan2(surface.normal.y(), surface.normal.x()));
  std::vector<Vector2d> out;
  for (const MeanBeam& beam : surface.beams)
    out.push_back(upright * point_of(beam, correction
                                               ? correction->apply(beam.range_mm, beam.intensity).range_mm
                                               : beam.range_mm));
  return out;
}

}  // namespace rig
