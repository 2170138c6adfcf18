// SPDX-License-Identifier: MIT
#include "fit/range/centre.hpp"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "fit/numeric/dense.hpp"
#include "fit/numeric/distributions.hpp"

namespace fit {
namespace {

Eigen::Matrix2d rotation(double rad) {
  Eigen::Matrix2d r;
  r << std::cos(rad), -std::sin(rad), std::sin(rad), std::cos(rad);
  return r;
}

/// Square root of a sight's covariance, columns radial and tangential.
Eigen::Matrix2d root_covariance(const CentrePoint& point) {
  return rotation(point.beam_rad) *
         Eigen::Vector2d(point.u_range_mm, point.range_mm * point.u_angle_rad).asDiagonal();
}

void judge(CentreFit& fit) {
  if (fit.degrees_of_freedom < 1) return;
  if (fit.chi2 <= chi_squared_quantile(fit.degrees_of_freedom, 0.99)) return;
  fit.inflation = std::sqrt(fit.chi2 / fit.degrees_of_freedom);
  for (Eigen::Matrix2d* part : {&fit.covariance, &fit.from_range, &fit.from_angle})
    *part *= fit.inflation * fit.inflation;
  for (Eigen::Matrix2d& part : fit.angle_parts) part *= fit.inflation * fit.inflation;
  for (Eigen::Vector2d& effect : fit.effects) effect *= fit.inflation;
}

/// Generalised least squares: solution = matrix * observations.
struct Gain {
  Eigen::MatrixXd matrix;
  Eigen::MatrixXd root;  ///< Of the observations' covariance, lower triangle.
  [[nodiscard]] double chi2(const Eigen::VectorXd& residual) const {
    return root.triangularView<Eigen::Lower>().solve(residual).squaredNorm();
  }
};

/// `sigma`: of every observation on its own; a column of `shifts`: what they have in common.
Gain gain_of(const Eigen::MatrixXd& design, const Eigen::VectorXd& sigma, const Eigen::MatrixXd& shifts) {
  Eigen::MatrixXd covariance = shifts * shifts.transpose();
  covariance.diagonal() += sigma.cwiseAbs2();
  Gain out;
  out.root = dense::cholesky(covariance);
  const auto root = out.root.triangularView<Eigen::Lower>();
  const Eigen::MatrixXd whitened = root.solve(design), inverse = dense::pseudo_inverse(whitened);
  out.matrix = root.solve<Eigen::OnTheRight>(inverse);
  return out;
}

void add_effects(CentreFit& fit, const Eigen::MatrixXd& on_centre) {
  for (Eigen::Index k = 0; k < on_centre.cols(); ++k) {
    fit.effects.emplace_back(on_centre.col(k));
    fit.covariance += on_centre.col(k) * on_centre.col(k).transpose();
  }
}

double condition_of(Eigen::MatrixXd design) {
  for (int column = 0; column < design.cols(); ++column) {
    const double length = design.col(column).norm();
    if (length > 0) design.col(column) /= length;
  }
  const Eigen::VectorXd values = dense::right_singular(design).values;
  return values(values.size() - 1) > 0 ? values(0) / values(values.size() - 1)
                                       : std::numeric_limits<double>::infinity();
}

}  // namespace

Eigen::Vector2d centre_from_pair(const Eigen::Vector2d& before, const Eigen::Vector2d& after,
                                 double turn_rad) {
  if (std::abs(std::sin(turn_rad / 2)) < 1e-9)
    throw std::invalid_argument(
        "the lidar did not turn between the two sights: they do not determine its axis");
  const double q = 0.5 / std::tan(turn_rad / 2);
  return {(before.x() + after.x()) / 2 - q * (before.y() - after.y()),
          (before.y() + after.y()) / 2 + q * (before.x() - after.x())};
}

CentrePair centre_of_pair(const std::vector<CentrePoint>& points, std::size_t first, std::size_t second,
                          const std::vector<CentreEffect>& effects) {
  const CentrePoint &a = points.at(first), &b = points.at(second);
  CentrePair pair{first, second, b.stage_rad - a.stage_rad, {}, Eigen::Matrix2d::Zero()};
  pair.centre = centre_from_pair(a.position(), b.position(), pair.turn_rad);
  pair.covariance = mean_of_pairs(points, {pair}, effects).covariance;
  return pair;
}

CentreMean mean_of_pairs(const std::vector<CentrePoint>& points, const std::vector<CentrePair>& pairs,
                         const std::vector<CentreEffect>& effects) {
  CentreMean mean;
  const double share = 1 / static_cast<double>(pairs.size());
  std::vector<Eigen::Matrix2d> gains(points.size(), Eigen::Matrix2d::Zero());
  for (const CentrePair& pair : pairs) {
    mean.centre += share * pair.centre;
    // after = R(-turn) before + (I - R(-turn)) centre.
    const Eigen::Matrix2d turn = rotation(-pair.turn_rad);
    const Eigen::Matrix2d inverse = (Eigen::Matrix2d::Identity() - turn).inverse();
    gains[pair.first] -= share * inverse * turn;
    gains[pair.second] += share * inverse;
  }
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Matrix2d root = gains[i] * root_covariance(points[i]);
    mean.covariance += root * root.transpose();
  }
  for (const CentreEffect& effect : effects) {
    Eigen::Vector2d moved = Eigen::Vector2d::Zero();
    for (std::size_t i = 0; i < points.size(); ++i)
      moved += gains[i] * rotation(points[i].beam_rad) * effect.shift_mm.at(i);
    mean.covariance += moved * moved.transpose();
  }
  return mean;
}

CentreFit fit_centre(const std::vector<CentrePoint>& points, const std::vector<CentreEffect>& effects) {
  const auto n = static_cast<Eigen::Index>(points.size());
  if (n < 2)
    throw std::invalid_argument("the rotation centre needs the same point seen from two stage angles");
  // Every sight in its own frame, radial and tangential.
  Eigen::MatrixXd design(2 * n, 4);
  Eigen::VectorXd seen(2 * n), sigma(2 * n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const CentrePoint& point = points[static_cast<std::size_t>(i)];
    design.block<2, 2>(2 * i, 0) = rotation(-point.beam_rad - point.stage_rad);
    design.block<2, 2>(2 * i, 2) = rotation(-point.beam_rad);
    seen.segment<2>(2 * i) = Eigen::Vector2d(point.range_mm, 0);
    sigma.segment<2>(2 * i) = Eigen::Vector2d(point.u_range_mm, point.range_mm * point.u_angle_rad);
  }
  const Eigen::MatrixXd weighed = sigma.cwiseInverse().asDiagonal() * design;
  if (!weighed.allFinite())
    throw std::invalid_argument("a sight has no uncertainty, so it cannot be weighed");
  CentreFit fit;
  fit.condition = condition_of(weighed);
  if (fit.condition > 1e7)
    throw std::invalid_argument("the lidar barely turned between the sights: they do not determine its axis");
  Eigen::MatrixXd shifts(2 * n, static_cast<Eigen::Index>(effects.size()));
  for (std::size_t k = 0; k < effects.size(); ++k)
    for (Eigen::Index i = 0; i < n; ++i)
      shifts.block<2, 1>(2 * i, static_cast<Eigen::Index>(k)) =
          effects[k].shift_mm.at(static_cast<std::size_t>(i));
  const Gain gain = gain_of(design, sigma, shifts);
  const Eigen::Vector4d solution = gain.matrix * seen;
  fit.point = solution.head<2>();
  fit.centre = solution.tail<2>();
  const Eigen::VectorXd residual = seen - design * solution;
  fit.chi2 = gain.chi2(residual);
  fit.degrees_of_freedom = static_cast<int>(2 * n - 4);
  for (Eigen::Index i = 0; i < n; ++i) {
    fit.residuals.emplace_back(residual.segment<2>(2 * i));
    const Eigen::Vector2d radial = gain.matrix.block<2, 1>(2, 2 * i) * sigma(2 * i),
                          tangential = gain.matrix.block<2, 1>(2, 2 * i + 1) * sigma(2 * i + 1);
    fit.from_range += radial * radial.transpose();
    fit.angle_parts.emplace_back(tangential * tangential.transpose());
    fit.from_angle += fit.angle_parts.back();
  }
  fit.covariance = fit.from_range + fit.from_angle;
  add_effects(fit, gain.matrix.bottomRows(2) * shifts);
  judge(fit);
  return fit;
}

CentreFit fit_centre_from_lines(const std::vector<BoardLine>& lines, const std::vector<LineEffect>& effects) {
  const auto n = static_cast<Eigen::Index>(lines.size());
  if (n < 3)
    throw std::invalid_argument("the centre from the board's line needs the board from three stage angles");
  Eigen::MatrixXd design(n, 3);
  Eigen::VectorXd seen(n), sigma(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const BoardLine& line = lines[static_cast<std::size_t>(i)];
    design.row(i) = Eigen::RowVector3d(1, std::cos(line.normal_rad), std::sin(line.normal_rad));
    seen(i) = line.distance_mm;
    sigma(i) = line.u_distance_mm;
  }
  CentreFit fit;
  const Eigen::MatrixXd weighed = sigma.cwiseInverse().asDiagonal() * design;
  fit.condition = condition_of(weighed);
  if (!weighed.allFinite() || fit.condition > 1e7)
    throw std::invalid_argument("the lidar barely turned between the sights of the board");
  Eigen::MatrixXd shifts(n, static_cast<Eigen::Index>(effects.size()));
  for (std::size_t k = 0; k < effects.size(); ++k)
    for (Eigen::Index i = 0; i < n; ++i)
      shifts(i, static_cast<Eigen::Index>(k)) = effects[k].shift_mm.at(static_cast<std::size_t>(i));
  const Gain gain = gain_of(design, sigma, shifts);
  const Eigen::Vector3d solution = gain.matrix * seen;
  fit.centre = solution.tail<2>();
  fit.point = {solution(0), 0};
  const Eigen::VectorXd residual = seen - design * solution;
  fit.chi2 = gain.chi2(residual);
  fit.degrees_of_freedom = static_cast<int>(n - 3);
  const Eigen::MatrixXd rows = gain.matrix.bottomRows<2>() * sigma.asDiagonal();
  fit.covariance = fit.from_range = rows * rows.transpose();
  add_effects(fit, gain.matrix.bottomRows(2) * shifts);
  for (Eigen::Index i = 0; i < n; ++i) fit.residuals.emplace_back(residual(i), 0);
  judge(fit);
  return fit;
}

Eigen::Vector2d about_centre(const Eigen::Vector2d& point, const Eigen::Vector2d& centre) {
  return point - centre;
}

Eigen::Vector2d to_map(double corrected_mm, double beam_rad, const Eigen::Vector2d& mount,
                       const Eigen::Vector2d& centre, const RobotPose& robot) {
  const Eigen::Vector2d seen(corrected_mm * std::cos(beam_rad), corrected_mm * std::sin(beam_rad));
  return rotation(robot.heading_rad) * (seen + mount - centre) + Eigen::Vector2d(robot.x_mm, robot.y_mm);
}

}  // namespace fit
