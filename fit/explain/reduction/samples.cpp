// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/samples.hpp"

#include <algorithm>
#include <cmath>

namespace fit::explain::reduction {
namespace {

Samples columns_by_step(const CaptureInfo& capture, const LidarGeometry& lidar) {
  Samples columns;
  columns.beams = capture.beams();
  for (int k = 0; k < columns.beams; ++k) {
    const double step = capture.step_of(k);
    columns.beam_rad.push_back(lidar.beam_angle(step));
    columns.beam_s.push_back(lidar.beam_time_s(step));
  }
  return columns;
}

/// Of one full turn of the mirror, seconds.
double turn_time(const ScanGeometry& geometry, std::size_t ranges, const LidarGeometry& lidar) {
  const double swept = std::abs(geometry.step_rad) * static_cast<double>(ranges);
  if (geometry.scan_s && *geometry.scan_s > 0 && swept > 0) return *geometry.scan_s * 2 * pi / swept;
  return 1 / lidar.scan_hz;
}

Samples columns_by_angle(const ScanGeometry& geometry, double turn_s, double through_rad) {
  Samples columns;
  columns.grid.emplace(through_rad, geometry.step_rad);
  columns.beams = static_cast<int>(columns.grid->count());
  for (std::size_t k = 0; k < columns.grid->count(); ++k) {
    columns.beam_rad.push_back(columns.grid->middle_rad(k));
    const double since_first = std::fmod(columns.beam_rad.back() - geometry.first_rad + 4 * pi, 2 * pi);
    columns.beam_s.push_back(since_first / (2 * pi) * turn_s);
  }
  return columns;
}

}  // namespace

Samples columns_for(const ScanView& scan, const CaptureInfo& capture, const LidarGeometry& lidar,
                    double through_rad) {
  if (!scan.geometry) return columns_by_step(capture, lidar);
  return columns_by_angle(*scan.geometry, turn_time(*scan.geometry, scan.range_mm.size(), lidar),
                          through_rad);
}

bool Samples::add(const ScanView& scan, const CaptureInfo& capture, TurnCounter& turns) {
  if (!(scan.geometry ? add_by_angle(scan) : add_by_step(scan))) return false;
  // A scan came without intensities: then nobody knows which are whose.
  if (intensity.size() != range.size()) intensity.clear();
  since_start_s.push_back(std::max(0.0, static_cast<double>(scan.host_us - capture.started_us) * 1e-6));
  seq.push_back(scan.seq);
  turn.push_back(turns.at(scan.device_ms));
  ++scans;
  return true;
}

void Samples::do_not_look(double from_rad, double to_rad) {
  for (int beam = 0; beam < beams; ++beam)
    if (const double rad = beam_rad[static_cast<std::size_t>(beam)]; rad >= from_rad && rad <= to_rad)
      for (int scan = 0; scan < scans; ++scan) range[index(scan, beam)] = not_looked;
}

bool Samples::add_by_step(const ScanView& scan) {
  if (beams <= 0 || grid || static_cast<int>(scan.range_mm.size()) < beams) return false;
  range.insert(range.end(), scan.range_mm.begin(), scan.range_mm.begin() + beams);
  raw.insert(raw.end(), scan.range_mm.begin(), scan.range_mm.begin() + beams);
  if (static_cast<int>(scan.intensity.size()) >= beams)
    intensity.insert(intensity.end(), scan.intensity.begin(), scan.intensity.begin() + beams);
  return true;
}

/// Every beam goes to the column that its own angle falls into; of two in one, the nearer to the middle.
bool Samples::add_by_angle(const ScanView& scan) {
  if (beams <= 0 || !grid) return false;
  const std::size_t first = range.size(), more = static_cast<std::size_t>(beams);
  range.resize(first + more, not_looked);
  aside_rad.resize(first + more, static_cast<float>(pi));
  const bool lit = scan.intensity.size() == scan.range_mm.size() && !scan.intensity.empty();
  if (lit) intensity.resize(first + more, 0.0F);
  for (std::size_t k = 0; k < scan.range_mm.size(); ++k) {
    const double angle = scan.geometry->first_rad + static_cast<double>(k) * scan.geometry->step_rad;
    const std::size_t column = grid->column_of(angle);
    const auto aside = static_cast<float>(wrap_angle(angle - beam_rad[column]));
    raw.push_back(scan.range_mm[k]);
    if (std::abs(aside) >= std::abs(aside_rad[first + column])) continue;
    aside_rad[first + column] = aside;
    range[first + column] = scan.range_mm[k];
    if (lit) intensity[first + column] = scan.intensity[k];
  }
  return true;
}

void bring_to_middle(Samples& samples, const Scene& scene, double stage_rad) {
  if (samples.aside_rad.empty()) return;
  for (int beam = 0; beam < samples.beams; ++beam) {
    const double middle = samples.beam_rad[static_cast<std::size_t>(beam)];
    const Sight at = scene.look(stage_rad, middle);
    if (at.target < 0) continue;
    for (int scan = 0; scan < samples.scans; ++scan) {
      const std::size_t i = samples.index(scan, beam);
      if (!is_echo(samples.range[i])) continue;
      const Sight own = scene.look(stage_rad, middle + samples.aside_rad[i]);
      if (own.target == at.target) samples.range[i] += static_cast<float>(at.range_mm - own.range_mm);
    }
  }
}

}  // namespace fit::explain::reduction
