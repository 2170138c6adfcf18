// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "fit/numeric/angle.hpp"
#include "sim/world.hpp"

namespace causal_test {

/// Boards given as {name, x1, y1, x2, y2, reflectance}, lidar at the axis with an exact mount.
struct Board {
  std::string name;
  double x1, y1, x2, y2, reflectance = 1;
};

inline sim::World world_of(const std::vector<Board>& boards) {
  sim::World world;
  world.bench.lidar.mount = {fit::Estimate{0}, fit::Estimate{0}, fit::Estimate{0}};
  for (const Board& board : boards) {
    fit::Target target;
    target.name = board.name;
    target.from_mm = {board.x1, board.y1};
    target.to_mm = {board.x2, board.y2};
    target.reflectance = board.reflectance;
    world.bench.targets.push_back(target);
  }
  // No self-heating: tests of other effects look at one moment. Little noise: their means show in few scans.
  world.receiver.noise = 2.5e-5;
  world.heat.rise_fast_k = world.heat.rise_slow_k = 0;
  return world;
}

/// The same with a lidar that looks only so far to either side: faster.
inline sim::World narrow(sim::World world, double deg = 20) {
  world.bench.lidar.front_step = static_cast<int>(4 * deg);
  world.bench.lidar.steps = static_cast<int>(8 * deg) + 1;
  return world;
}

/// A wall square on straight ahead.
inline sim::World wall_at(double distance_mm, double reflectance = 1) {
  return world_of({{"wall", distance_mm, -4000, distance_mm, 4000, reflectance}});
}

/// A wall straight ahead, seen at that incidence; its range grows with the beam angle.
inline sim::World slanted(double distance_mm, double incidence_deg, double reflectance = 1) {
  const double a = (90 - incidence_deg) * fit::rad_per_deg;
  const double dx = 3000 * std::cos(a), dy = 3000 * std::sin(a);
  return world_of({{"wall", distance_mm - dx, -dy, distance_mm + dx, dy, reflectance}});
}

struct Cell {
  std::vector<double> ranges;
  double intensity = 0;  ///< Mean.
  int lost = 0;

  [[nodiscard]] double mean() const {
    double sum = 0;
    for (const double r : ranges) sum += r;
    return sum / static_cast<double>(ranges.size());
  }
  [[nodiscard]] double sd() const {
    const double m = mean();
    double sum = 0;
    for (const double r : ranges) sum += (r - m) * (r - m);
    return std::sqrt(sum / static_cast<double>(ranges.size() - 1));
  }
};

struct Recording {
  std::vector<Cell> cells;
  int front = 540;
  [[nodiscard]] const Cell& at(double beam_deg) const {
    return cells[static_cast<std::size_t>(std::lround(front + 4 * beam_deg))];
  }
};

/// Records scans from one engine; `stage_deg` as a function of the time since power-on.
inline Recording record_steps(
    sim::Engine& engine, const fit::LidarGeometry& lidar, int scans, double from_s = 0,
    const std::function<sim::StageMoment(double)>& stage = [](double) { return sim::StageMoment{}; }) {
  Recording recording;
  const auto steps = static_cast<std::size_t>(lidar.steps);
  std::vector<std::uint32_t> range(steps), intensity(steps);
  recording.cells.resize(steps);
  recording.front = lidar.front_step;
  for (int i = 0; i < scans; ++i) {
    engine.scan(from_s + i * 0.025, stage, range, intensity);
    for (std::size_t k = 0; k < range.size(); ++k) {
      Cell& cell = recording.cells[k];
      if (range[k] <= 4 || range[k] >= 65000) {
        ++cell.lost;
        continue;
      }
      cell.ranges.push_back(range[k]);
      cell.intensity += intensity[k];
    }
  }
  for (Cell& cell : recording.cells) {
    if (!cell.ranges.empty()) cell.intensity /= static_cast<double>(cell.ranges.size());
  }
  return recording;
}

inline Recording record(const sim::World& world, int scans, double from_s = 0, std::uint64_t seed = 1) {
  const auto engine = sim::make_causal_engine(world, seed);
  return record_steps(*engine, world.bench.lidar, scans, from_s);
}

/// Correlation of a series with itself one step later.
inline double lag_one(const std::vector<double>& x) {
  double mean = 0, top = 0, bottom = 0;
  for (const double v : x) mean += v / static_cast<double>(x.size());
  for (std::size_t i = 0; i < x.size(); ++i) {
    bottom += (x[i] - mean) * (x[i] - mean);
    if (i > 0) top += (x[i] - mean) * (x[i - 1] - mean);
  }
  return top / bottom;
}

inline constexpr double half_light = 149.896229;  // mm per ns, there and back

/// Echo of a board square on: inverse square and overlap.
inline double echo(const sim::World& world, double range, double reflectance) {
  const double near = world.receiver.overlap_mm;
  const double overlap = std::pow(range * range / (range * range + near * near), 2);
  return reflectance * overlap * 1e6 / (range * range);
}

inline double bias(sim::World world, double distance, int scans = 300) {
  return record(narrow(std::move(world), 1), scans).at(0).mean() - distance;
}

inline double correlation(const std::vector<double>& x, const std::vector<double>& y) {
  double mx = 0, my = 0, xy = 0, xx = 0, yy = 0;
  const auto n = static_cast<double>(x.size());
  for (std::size_t i = 0; i < x.size(); ++i) mx += x[i] / n, my += y[i] / n;
  for (std::size_t i = 0; i < x.size(); ++i) {
    xy += (x[i] - mx) * (y[i] - my);
    xx += (x[i] - mx) * (x[i] - mx);
    yy += (y[i] - my) * (y[i] - my);
  }
  return xy / std::sqrt(xx * yy);
}

/// Range at which a beam of that bearing meets the line of a wall seen at `incidence_deg` at 0.
inline double along_slant(double distance, double incidence_deg, double bearing_rad) {
  const double i = incidence_deg * fit::rad_per_deg;
  return distance * std::cos(i) / std::cos(i + bearing_rad);
}

}  // namespace causal_test
