// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <complex>
#include <optional>
#include <string>
#include <vector>

/// A bench written from formats.md with plane trigonometry alone: points are complex numbers, nothing of the
/// project's own scene takes part.
namespace plain_bench {

using Point = std::complex<double>;
inline constexpr double degree = 3.14159265358979323846 / 180;

struct Wall {
  Point from, to;
};

/// Where the lidar sits on the stage, as the bench file has it.
struct Mount {
  double x_mm = 0, y_mm = 0, yaw_deg = 0;
};

/// How a beam differs from what the bench file says of it, by the columns of physics.md.
struct Deviation {
  double range_mm = 0, beam_rad = 0, stage_rad = 0;
  Point origin_mm = 0;
};

/// What a beam meets.
struct Met {
  std::size_t wall = 0;
  double range_mm = 0;
  double incidence_rad = 0;  ///< Between beam and normal; positive where the range grows with the beam angle.
  double along_mm = 0;       ///< From the wall's middle, towards its end `to`.
};

/// Beam at angle `beam_rad` of a lidar on a stage at `stage_rad`: "it points to theta + mount.yaw + alpha in
/// the world; the beam starts at R(theta) * (mount.x, mount.y)".
inline std::optional<Met> look(const std::vector<Wall>& walls, const Mount& mount, double stage_rad,
                               double beam_rad, const Deviation& off = {}) {
  const double stage = stage_rad + off.stage_rad;
  const Point start = std::polar(1.0, stage) * Point(mount.x_mm, mount.y_mm) + off.origin_mm;
  const double bearing = stage + mount.yaw_deg * degree + beam_rad + off.beam_rad;
  std::optional<Met> nearest;
  for (std::size_t i = 0; i < walls.size(); ++i) {
    // In a frame that begins at the lidar and whose x axis is the beam, the wall crosses that axis.
    const Point turn = std::polar(1.0, -bearing);
    const Point from = (walls[i].from - start) * turn, to = (walls[i].to - start) * turn;
    if ((from.imag() > 0) == (to.imag() > 0)) continue;
    const double share = from.imag() / (from.imag() - to.imag());
    const Point at = from + share * (to - from);
    if (at.real() <= 0 || (nearest && at.real() >= nearest->range_mm)) continue;
    Point upward = to - from;
    if (upward.imag() < 0) upward = -upward;  // along the wall with growing beam angle
    nearest =
        Met{i, at.real(), std::atan2(upward.real(), upward.imag()), (share - 0.5) * std::abs(to - from)};
  }
  if (nearest) nearest->range_mm += off.range_mm;
  return nearest;
}

}  // namespace plain_bench
