// SPDX-License-Identifier: MIT
#include "sim/causal/rotor.hpp"

#include <algorithm>
#include <cmath>

namespace sim::causal {

Rotor::Rotor(const World::Rotor& settings, const fit::LidarGeometry& lidar)
    : settings_(settings), lidar_(lidar) {
  const std::size_t count = std::max<std::size_t>(1, settings_.facets.size());
  for (std::size_t face = 0; face < count; ++face) {
    const double aside = settings_.facets.empty() ? 0 : settings_.facets[face].angle_rad;
    auto& table = faces_.emplace_back();
    for (int step = 0; step < lidar_.steps; ++step) table.push_back(trace(lidar_.beam_angle(step), aside));
  }
  directions_ = faces_.front();
  if (!settings_.facets.empty()) facet_mm_ = settings_.facets.front().range_mm;
}

void Rotor::turn(std::size_t scan) {
  if (settings_.facets.empty()) return;
  face_ = scan % settings_.facets.size();
  directions_ = faces_[face_];
  facet_mm_ = settings_.facets[face_].range_mm;
}

Rotor::Direction Rotor::trace(double nominal, double facet_rad) const {
  const double seen = nominal + settings_.disk_phase_rad;
  const double e = settings_.disk_offset;
  // The mark at angle `seen` of a disk whose centre is e off the axis stands at this angle about the axis.
  double angle = nominal + std::atan2(e * std::sin(seen), 1 - e * std::cos(seen));
  const double lean = nominal + settings_.disk_lean_phase_rad;
  angle += std::remainder(
      std::atan2(std::sin(lean), std::cos(lean) * std::cos(settings_.disk_lean_rad)) - lean, 2 * fit::pi);
  angle += settings_.speed_error * nominal;
  angle += settings_.ripple_rad * std::sin(settings_.ripple_order * nominal);
  if (nominal >= settings_.lost_slit_at_rad) angle += settings_.lost_slit_rad;
  if (settings_.slits > 0) {
    const double turns = nominal * settings_.slits / (2 * fit::pi);
    angle += settings_.interpolation_rad * (2 * (turns - std::floor(turns)) - 1);
  }
  angle += facet_rad;
  if (settings_.plane_tilt_rad == 0) return {angle, 0};
  // Beams turn in a plane that leans by the tilt about plane_axis: exact rotation of the unit vector.
  const double about = angle - settings_.plane_axis_rad;
  const double across = std::sin(about), along = std::cos(about);
  return {settings_.plane_axis_rad + std::atan2(across * std::cos(settings_.plane_tilt_rad), along),
          across * std::sin(settings_.plane_tilt_rad)};
}

}  // namespace sim::causal
