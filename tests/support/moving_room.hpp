// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <vector>

// A room seen by a lidar that moves: every beam is cast from where the lidar is at that beam's own time.
// Written with plain numbers and nothing of the product, so that it can judge it.
namespace room {

struct Point {
  double x = 0, y = 0;
};
struct Pose {
  double x = 0, y = 0, heading = 0;
};
struct Wall {
  Point from, to;
};

constexpr double deg = std::numbers::pi / 180;

/// A room with a niche, a pillar and a slanting board: something to see in every direction.
inline std::vector<Wall> furnished() {
  const std::vector<Point> outline{{-2500, -1800}, {3200, -1800}, {3200, 900},
                                   {1900, 900},    {1900, 2300},  {-2500, 2300}};
  std::vector<Wall> walls;
  for (std::size_t i = 0; i < outline.size(); ++i)
    walls.push_back({outline[i], outline[(i + 1) % outline.size()]});
  const std::vector<Point> pillar{{-1400, 900}, {-1000, 900}, {-1000, 1300}, {-1400, 1300}};
  for (std::size_t i = 0; i < pillar.size(); ++i)
    walls.push_back({pillar[i], pillar[(i + 1) % pillar.size()]});
  walls.push_back({{700, -1500}, {1500, -1000}});
  return walls;
}

inline double range_to(const std::vector<Wall>& walls, const Pose& at) {
  double nearest = 1e9;
  const double dx = std::cos(at.heading), dy = std::sin(at.heading);
  for (const Wall& w : walls) {
    const double ax = w.to.x - w.from.x, ay = w.to.y - w.from.y;
    const double facing = dx * ay - dy * ax;
    if (std::abs(facing) < 1e-12) continue;
    const double ox = w.from.x - at.x, oy = w.from.y - at.y;
    const double range = (ox * ay - oy * ax) / facing, place = (ox * dy - oy * dx) / facing;
    if (range > 0 && range < nearest && place >= 0 && place <= 1) nearest = range;
  }
  return nearest;
}

/// Signed-free distance of a point from the nearest wall.
inline double distance_from(const std::vector<Wall>& walls, const Point& p) {
  double nearest = 1e9;
  for (const Wall& w : walls) {
    const double ax = w.to.x - w.from.x, ay = w.to.y - w.from.y, ox = p.x - w.from.x, oy = p.y - w.from.y;
    const double share = std::clamp((ox * ax + oy * ay) / (ax * ax + ay * ay), 0.0, 1.0);
    nearest = std::min(nearest, std::hypot(ox - share * ax, oy - share * ay));
  }
  return nearest;
}

inline Point placed(const Pose& at, double x, double y) {
  return {at.x + std::cos(at.heading) * x - std::sin(at.heading) * y,
          at.y + std::sin(at.heading) * x + std::cos(at.heading) * y};
}

/// Root mean square distance from the walls, beyond `cut` left out (edges, where a beam meets the other
/// surface).
inline double rms_from(const std::vector<Wall>& walls, const std::vector<Point>& points, double cut = 1e9) {
  double sum = 0;
  std::size_t count = 0;
  for (const Point& p : points) {
    const double d = distance_from(walls, p);
    if (d > cut) continue;
    sum += d * d;
    ++count;
  }
  return count ? std::sqrt(sum / static_cast<double>(count)) : 1e9;
}

/// The same after the rigid motion that makes it least: what is left is distortion and noise. Found by trying
/// ever smaller steps, without derivatives.
inline double rms_at_best(const std::vector<Wall>& walls, const std::vector<Point>& points) {
  Pose best;
  const auto cost = [&](const Pose& at) {
    std::vector<Point> moved;
    for (const Point& p : points) moved.push_back(placed(at, p.x, p.y));
    return rms_from(walls, moved);
  };
  double least = cost(best);
  for (double step = 32; step > 0.2; step /= 2) {
    for (bool better = true; better;) {
      better = false;
      for (const Pose& d : {Pose{step, 0, 0}, Pose{-step, 0, 0}, Pose{0, step, 0}, Pose{0, -step, 0},
                            Pose{0, 0, step / 2000}, Pose{0, 0, -step / 2000}}) {
        const Pose next{best.x + d.x, best.y + d.y, best.heading + d.heading};
        if (const double now = cost(next); now < least) {
          least = now;
          best = next;
          better = true;
        }
      }
    }
  }
  return least;
}

/// One scan of `beams` over 270 degrees at 40 Hz, in whole millimetres. `lidar_at` tells where the lidar is.
inline std::vector<std::uint16_t> scan(const std::vector<Wall>& walls,
                                       const std::function<Pose(double)>& lidar_at, double begin_s,
                                       double sigma_mm, std::mt19937& random, int beams = 1081) {
  std::normal_distribution<double> gauss(0, std::max(1e-12, sigma_mm));
  std::vector<std::uint16_t> ranges;
  const double step = 270 * deg / (beams - 1);
  for (int k = 0; k < beams; ++k) {
    Pose at = lidar_at(begin_s + k * step / (2 * std::numbers::pi * 40));
    at.heading += -135 * deg + k * step;
    const double range = range_to(walls, at);
    ranges.push_back(
        range < 10'000 ? static_cast<std::uint16_t>(std::lround(std::max(30.0, range + gauss(random)))) : 0);
  }
  return ranges;
}

}  // namespace room
