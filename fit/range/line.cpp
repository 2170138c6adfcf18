// SPDX-License-Identifier: MIT
#include "fit/range/line.hpp"

#include <Eigen/Core>

#include "fit/numeric/angle.hpp"

namespace fit {

using Eigen::Vector2d;

LineFit fit_line(std::span<const Vector2d> points) {
  const auto n = static_cast<double>(points.size());
  Vector2d mean = Vector2d::Zero();
  for (const Vector2d& p : points) mean += p / n;
  double xx = 0, xy = 0, yy = 0;
  for (const Vector2d& p : points) {
    const Vector2d d = p - mean;
    xx += d.x() * d.x(), xy += d.x() * d.y(), yy += d.y() * d.y();
  }
  const double along = 0.5 * std::atan2(2 * xy, xx - yy);
  Vector2d normal(-std::sin(along), std::cos(along));
  if (normal.dot(mean) < 0) normal = -normal;
  LineFit fit;
  fit.points = points.size();
  fit.line = {std::atan2(normal.y(), normal.x()), normal.dot(mean)};
  const double half = 0.5 * (xx + yy), root = std::hypot(0.5 * (xx - yy), xy);
  const double across = std::max(0.0, half - root), length = std::max(1e-12, half + root);
  const double variance = n > 2 ? across / (n - 2) : 0;
  fit.rms_mm = std::sqrt(variance);
  // About the centroid, turn and offset are independent; the origin's distance gets its lever.
  const double lever = Vector2d(-normal.y(), normal.x()).dot(mean);
  const double turn = variance / length;
  fit.covariance << turn, lever * turn, lever * turn, variance / n + lever * lever * turn;
  return fit;
}

std::optional<RansacLine> find_line(std::span<const Vector2d> points, const RansacOptions& options) {
  const auto propose = [&](const std::vector<std::size_t>& chosen, Line2& line) {
    const Vector2d a = points[chosen[0]], d = points[chosen[1]] - a;
    if (d.norm() < 2 * options.tolerance) return false;
    Vector2d normal = Vector2d(-d.y(), d.x()).normalized();
    if (normal.dot(a) < 0) normal = -normal;
    line = {std::atan2(normal.y(), normal.x()), normal.dot(a)};
    return true;
  };
  const auto found = ransac<Line2>(points.size(), 2, options, propose, [&](const Line2& line, std::size_t i) {
    return std::abs(line.offset_of(points[i]));
  });
  if (found.inliers.size() < 3) return std::nullopt;
  std::vector<Vector2d> inside;
  for (const std::size_t i : found.inliers) inside.push_back(points[i]);
  return RansacLine{fit_line(inside), found.inliers};
}

}  // namespace fit
