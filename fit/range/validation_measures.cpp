// SPDX-License-Identifier: MIT
#include "fit/range/validation_measures.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "fit/numeric/dense.hpp"

namespace fit {
namespace {

struct Spread {
  double sd, low, high;
};

/// Jackknife over ten blocks of neighbours: the differences overlap and are far from independent.
Spread spread_of(const std::vector<double>& differences) {
  const auto sd_without = [&](std::size_t from, std::size_t to) {
    double n = 0, mean = 0, square = 0;
    for (std::size_t i = 0; i < differences.size(); ++i) {
      if (i >= from && i < to) continue;
      ++n;
      const double d = differences[i] - mean;
      mean += d / n;
      square += d * (differences[i] - mean);
    }
    return n > 1 ? std::sqrt(square / (n - 1)) : std::nan("");
  };
  const double whole = sd_without(0, 0);
  constexpr std::size_t blocks = 10;
  double mean = 0, square = 0;
  std::vector<double> logs;
  for (std::size_t b = 0; b < blocks; ++b)
    logs.push_back(
        std::log(sd_without(b * differences.size() / blocks, (b + 1) * differences.size() / blocks)));
  for (const double value : logs) mean += value / blocks;
  for (const double value : logs) square += (value - mean) * (value - mean);
  // Student's 97.5 % point with 9 degrees of freedom.
  const double reach = 2.262 * std::sqrt(square * (blocks - 1) / blocks);
  return {whole, whole * std::exp(-reach), whole * std::exp(reach)};
}

}  // namespace

DifferenceSpread difference_spread(std::span<const Eigen::Vector2d> points, int lag) {
  DifferenceSpread out;
  const auto step = static_cast<std::size_t>(lag);
  if (points.size() < step + 20) {
    out.sd_mm = out.plane_sd_mm = std::nan("");
    return out;
  }
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const auto& p : points) mean += p / static_cast<double>(points.size());
  Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
  for (const auto& p : points) scatter += (p - mean) * (p - mean).transpose();
  const Eigen::Vector2d normal = dense::symmetric_eigen(scatter).vectors.col(0);
  std::vector<double> plain, flat;
  for (std::size_t i = step; i < points.size(); ++i) {
    plain.push_back(points[i].y() - points[i - step].y());
    flat.push_back(normal.dot(points[i] - points[i - step]));
  }
  const Spread paper = spread_of(plain), plane = spread_of(flat);
  out.sd_mm = paper.sd, out.low_mm = paper.low, out.high_mm = paper.high;
  out.plane_sd_mm = plane.sd, out.plane_low_mm = plane.low, out.plane_high_mm = plane.high;
  out.pairs = static_cast<long>(plain.size());
  return out;
}

namespace {

/// To the line through neighbouring points; neighbours farther apart than the gate are not joined.
double distance_to(const Eigen::Vector2d& p, std::span<const Eigen::Vector2d> scene, double gate_mm) {
  double nearest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < scene.size(); ++i) {
    nearest = std::min(nearest, (p - scene[i]).norm());
    if (i == 0) continue;
    const Eigen::Vector2d along = scene[i] - scene[i - 1];
    const double length = along.norm();
    if (length <= 0 || length > gate_mm) continue;
    const double place = std::clamp((p - scene[i - 1]).dot(along) / (length * length), 0.0, 1.0);
    nearest = std::min(nearest, (p - scene[i - 1] - place * along).norm());
  }
  return nearest;
}

}  // namespace

SceneDistance scene_distance(std::span<const Eigen::Vector2d> a, std::span<const Eigen::Vector2d> b,
                             double gate_mm) {
  SceneDistance out;
  double sum = 0, square = 0;
  for (const auto& p : a) {
    const double nearest = distance_to(p, b, gate_mm);
    if (nearest > gate_mm) continue;
    sum += nearest, square += nearest * nearest, ++out.pairs;
  }
  const auto n = static_cast<double>(out.pairs);
  out.mean_mm = out.pairs ? sum / n : std::nan("");
  out.u_mm = out.pairs > 1 ? std::sqrt(std::max(0.0, square / n - out.mean_mm * out.mean_mm) / (n - 1))
                           : std::nan("");
  return out;
}

}  // namespace fit
