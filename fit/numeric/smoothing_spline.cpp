// SPDX-License-Identifier: MIT
#include "fit/numeric/smoothing_spline.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "fit/numeric/dense.hpp"

namespace fit {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

}  // namespace

SmoothingSpline::SmoothingSpline(std::span<const CurvePoint> points, int most_knots) {
  std::set<double> distinct;
  for (const CurvePoint& p : points) distinct.insert(p.x);
  const std::vector<double> xs(distinct.begin(), distinct.end());
  const std::size_t count = std::min(xs.size(), static_cast<std::size_t>(most_knots));
  for (std::size_t i = 0; i < count; ++i) knots_.push_back(xs[i * (xs.size() - 1) / (count - 1)]);
  const auto k = static_cast<Index>(count);
  const auto gap = [&](Index i) {
    return knots_[static_cast<std::size_t>(i) + 1] - knots_[static_cast<std::size_t>(i)];
  };
  // Reinsch's matrices: R m = Q^T g for the inner second derivatives m (Green and Silverman 1994, 2.1).
  MatrixXd q = MatrixXd::Zero(k, k - 2), r = MatrixXd::Zero(k - 2, k - 2);
  for (Index j = 0; j < k - 2; ++j) {
    q(j, j) = 1 / gap(j), q(j + 1, j) = -1 / gap(j) - 1 / gap(j + 1), q(j + 2, j) = 1 / gap(j + 1);
    r(j, j) = (gap(j) + gap(j + 1)) / 3;
    if (j + 1 < k - 2) r(j, j + 1) = r(j + 1, j) = gap(j + 1) / 6;
  }
  const MatrixXd inner = dense::solve_symmetric(r, q.transpose());
  second_ = MatrixXd::Zero(k, k);
  second_.middleRows(1, k - 2) = inner;
  const MatrixXd penalty = q * inner;
  MatrixXd normal = MatrixXd::Zero(k, k);
  VectorXd right = VectorXd::Zero(k);
  double yy = 0;
  for (const CurvePoint& p : points) {
    const Eigen::RowVectorXd b = weights_at(p.x);
    const double w = 1 / (p.u * p.u);
    normal += w * b.transpose() * b;
    right += w * p.y * b.transpose();
    yy += w * p.y * p.y;
  }
  normal.diagonal().array() += 1e-12 * normal.diagonal().maxCoeff();
  // In the basis where the fit is the unit matrix and the penalty diagonal, each strength costs O(knots).
  const MatrixXd lower = dense::cholesky(normal);
  const MatrixXd half = lower.triangularView<Eigen::Lower>().solve(penalty);
  const MatrixXd whitened = lower.triangularView<Eigen::Lower>().solve(half.transpose());
  const dense::SymmetricEigen eigen = dense::symmetric_eigen((whitened + whitened.transpose()) / 2);
  const VectorXd d = eigen.values.cwiseMax(0.0);
  const VectorXd z = eigen.vectors.transpose() * lower.triangularView<Eigen::Lower>().solve(right);
  const double n = static_cast<double>(points.size());
  double best = std::numeric_limits<double>::infinity(), strength = 0;
  for (double lambda = 1e-6 / d.maxCoeff(); lambda < 1e12 / d.maxCoeff(); lambda *= 1.5) {
    const VectorXd shrink = (1 + lambda * d.array()).inverse();
    const double rss =
        std::max(0.0, yy - (z.array().square() * (2 * shrink.array() - shrink.array().square())).sum());
    // 1.4: Kim and Gu's (2004) guard against following the noise.
    const double freedom = n - 1.4 * shrink.sum();
    if (freedom <= 0) continue;
    const double score = rss / (freedom * freedom);
    if (score < best) best = score, strength = lambda;
  }
  const VectorXd shrink = (1 + strength * d.array()).inverse();
  effective_ = shrink.sum();
  const MatrixXd back = lower.transpose().triangularView<Eigen::Upper>().solve(eigen.vectors);
  values_ = back * shrink.cwiseProduct(z);
  factor_ = back * shrink.cwiseSqrt().asDiagonal();
}

Eigen::RowVectorXd SmoothingSpline::weights_at(double x) const {
  const auto k = static_cast<Index>(knots_.size());
  const auto above = std::upper_bound(knots_.begin() + 1, knots_.end() - 1, x);
  const auto i = static_cast<Index>(above - knots_.begin()) - 1;
  const double left = knots_[static_cast<std::size_t>(i)], right = knots_[static_cast<std::size_t>(i) + 1];
  const double h = right - left, a = (right - x) / h, b = (x - left) / h;
  Eigen::RowVectorXd out = Eigen::RowVectorXd::Zero(k);
  out[i] = a, out[i + 1] = b;
  // Beyond the ends a natural spline is straight; close enough here, where it is never used.
  const double clipped_a = std::clamp(a, 0.0, 1.0), clipped_b = std::clamp(b, 0.0, 1.0);
  out += ((clipped_a * clipped_a * clipped_a - clipped_a) * second_.row(i) +
          (clipped_b * clipped_b * clipped_b - clipped_b) * second_.row(i + 1)) *
         (h * h / 6);
  return out;
}

double SmoothingSpline::value(double x) const { return weights_at(x).dot(values_.transpose()); }

double SmoothingSpline::u(double x) const { return (weights_at(x) * factor_).norm(); }

}  // namespace fit
