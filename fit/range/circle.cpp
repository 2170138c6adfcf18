// SPDX-License-Identifier: MIT
#include "fit/range/circle.hpp"

#include <Eigen/Core>
#include <Eigen/LU>

#include "fit/numeric/dense.hpp"

namespace fit {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

/// Through three points; false when they lie on a line.
bool circle_through(const Vector2d& a, const Vector2d& b, const Vector2d& c, Circle& circle) {
  const Vector2d ab = b - a, ac = c - a;
  const double twice = 2 * (ab.x() * ac.y() - ab.y() * ac.x());
  if (std::abs(twice) < 1e-9) return false;
  const double bb = ab.squaredNorm(), cc = ac.squaredNorm();
  const Vector2d d((ac.y() * bb - ab.y() * cc) / twice, (ab.x() * cc - ac.x() * bb) / twice);
  circle = {a + d, d.norm()};
  return true;
}

double squares(std::span<const Vector2d> points, const Circle& circle) {
  double sum = 0;
  for (const Vector2d& p : points) {
    const double d = circle.distance_of(p);
    sum += d * d;
  }
  return sum;
}

struct Normal3 {
  Matrix3d information = Matrix3d::Zero();
  Vector3d gradient = Vector3d::Zero();
};

Normal3 linearise(std::span<const Vector2d> points, const Circle& circle) {
  Normal3 out;
  for (const Vector2d& p : points) {
    const Vector2d arm = p - circle.centre;
    const double length = std::max(1e-12, arm.norm());
    const Vector3d row(-arm.x() / length, -arm.y() / length, -1);
    out.information += row * row.transpose();
    out.gradient -= row * (length - circle.radius);
  }
  return out;
}

void finish(CircleFit& fit, std::span<const Vector2d> points) {
  fit.points = points.size();
  const double freedom = std::max(1.0, static_cast<double>(points.size()) - 3);
  const double variance = squares(points, fit.circle) / freedom;
  fit.rms = std::sqrt(variance);
  fit.covariance = variance * linearise(points, fit.circle).information.inverse();
}

}  // namespace

CircleFit fit_circle_algebraic(std::span<const Vector2d> points) {
  Vector2d mean = Vector2d::Zero();
  for (const Vector2d& p : points) mean += p / static_cast<double>(points.size());
  Eigen::MatrixXd a(static_cast<Eigen::Index>(points.size()), 3);
  Eigen::VectorXd b(static_cast<Eigen::Index>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vector2d d = points[i] - mean;
    const auto row = static_cast<Eigen::Index>(i);
    a.row(row) << d.x(), d.y(), 1;
    b(row) = d.squaredNorm();
  }
  const Vector3d c = dense::least_squares(a, b);
  CircleFit fit;
  const Vector2d centre(c[0] / 2, c[1] / 2);
  fit.circle = {mean + centre, std::sqrt(std::max(0.0, c[2] + centre.squaredNorm()))};
  finish(fit, points);
  return fit;
}

CircleFit fit_circle(std::span<const Vector2d> points) {
  CircleFit fit = fit_circle_algebraic(points);
  fit.converged = false;
  double cost = squares(points, fit.circle), damping = 1e-3;
  for (int i = 0; i < 200 && !fit.converged; ++i) {
    Normal3 normal = linearise(points, fit.circle);
    normal.information.diagonal() *= 1 + damping;
    const Vector3d step = dense::solve_symmetric(normal.information, normal.gradient);
    const Circle next{fit.circle.centre + step.head<2>(), fit.circle.radius + step[2]};
    const double now = squares(points, next);
    if (now <= cost && next.radius > 0) {
      fit.converged = step.norm() < 1e-9 * (1 + next.radius);
      fit.circle = next;
      cost = now;
      damping = std::max(1e-12, damping / 10);
    } else {
      damping *= 10;
      fit.converged = damping > 1e12;
    }
  }
  finish(fit, points);
  return fit;
}

std::optional<RansacCircle> find_circle(std::span<const Vector2d> points, double first_tolerance,
                                        double second_tolerance, double largest_radius) {
  std::vector<std::size_t> left(points.size());
  for (std::size_t i = 0; i < left.size(); ++i) left[i] = i;
  for (const double tolerance : {first_tolerance, second_tolerance}) {
    RansacOptions options;
    options.tolerance = tolerance;
    const auto propose = [&](const std::vector<std::size_t>& chosen, Circle& circle) {
      return circle_through(points[left[chosen[0]]], points[left[chosen[1]]], points[left[chosen[2]]],
                            circle) &&
             circle.radius <= largest_radius;
    };
    const auto found = ransac<Circle>(
        left.size(), 3, options, propose,
        [&](const Circle& circle, std::size_t i) { return circle.distance_of(points[left[i]]); });
    std::vector<std::size_t> inside;
    for (const std::size_t i : found.inliers) inside.push_back(left[i]);
    left = std::move(inside);
  }
  if (left.size() < 3) return std::nullopt;
  // Three points fix their circle badly: whoever lies near it is no fair choice before the fit has settled.
  constexpr int most_rounds = 20;
  RansacCircle found{{}, left};
  for (int round = 0; round < most_rounds; ++round) {
    std::vector<Vector2d> kept;
    for (const std::size_t i : found.inliers) kept.push_back(points[i]);
    found.fit = fit_circle(kept);
    std::vector<std::size_t> near;
    for (std::size_t i = 0; i < points.size(); ++i)
      if (found.fit.circle.distance_of(points[i]) <= second_tolerance) near.push_back(i);
    if (near.size() < 3 || near == found.inliers) break;
    found.inliers = std::move(near);
  }
  return found;
}

}  // namespace fit
