// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <vector>

#include "sim/causal/receiver.hpp"
#include "sim/causal/scene.hpp"

namespace sim::causal {

/// One beam on its way out.
struct Beam {
  Eigen::Vector2d origin;
  double bearing = 0;  ///< In the world.
  double device = 0;   ///< In the lidar: the footprint turns with it.
  double rise = 0;     ///< Sine of the elevation.
  double loss = 0;     ///< Of the window, one way.
};

/// Footprint, targets and collection optics: turns a beam into the echoes of its sub-rays.
///
/// The emitter stands still while the mirror turns, so the elliptic footprint turns with the beam: its width
/// in the scan plane is sqrt((long cos)^2 + (short sin)^2) (UST-10LX manual, figure 4: 160 x 25 mm at 10 m in
/// front, 25 x 160 mm at the side). Echo power falls with the inverse square of range, the cosine of
/// incidence and the overlap of emitter and detector (Hoefle and Pfeifer, ISPRS J. Photogramm. 62 (2007)
/// 415). A slanted wall stretches the pulse (Soudarissanane et al. 2009); a glossy one sends part of the
/// light on to another target, which answers by the same way, later.
class Optics {
 public:
  Optics(const World& world, const Scene& scene);

  /// Echoes of a beam, sorted by time; appends to `echoes` after clearing it.
  void trace(const Beam& beam, std::vector<Echo>& echoes) const;
  /// Width of the footprint in the scan plane, rad, of a beam at that angle in the device.
  [[nodiscard]] double width(double device_angle) const;

 private:
  struct SubRay {
    double place;  ///< -1..1 across the footprint.
    double weight;
  };
  void add(const Beam& beam, const Eigen::Vector2d& ray, const Hit& hit, double weight,
           const Eigen::Vector2d& from, std::vector<Echo>& echoes) const;
  void glossy(const Eigen::Vector2d& ray, const Hit& hit, double weight, const Eigen::Vector2d& from,
              double share, std::vector<Echo>& echoes) const;
  [[nodiscard]] double delay_ns(double range, double rise) const;
  [[nodiscard]] double overlap(double range) const;

  const World& world_;
  const Scene& scene_;
  std::vector<SubRay> few_, many_;
};

}  // namespace sim::causal
