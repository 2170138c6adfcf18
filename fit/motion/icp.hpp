// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>
#include <vector>

#include "fit/motion/pose2.hpp"

namespace fit {

/// A point of a surface and the direction square to that surface; the normal is zero where no surface is seen
/// (isolated points, corners).
struct OrientedPoint {
  Eigen::Vector2d at_mm = Eigen::Vector2d::Zero();
  Eigen::Vector2d normal = Eigen::Vector2d::Zero();
};

/// Finds the normals of points that a beam swept one after another, from the neighbours within `radius_mm`
/// along the sweep. Points of a flat piece are moved onto its line, which takes out part of their noise.
std::vector<OrientedPoint> orient_sweep(std::span<const Eigen::Vector2d> sweep, double radius_mm = 120);

/// Points with fast search of the nearest one. A grid, not a tree: points of a sweep lie evenly along walls,
/// and building a tree anew for every scan takes as long as the matching.
class PointCloud {
 public:
  PointCloud();
  explicit PointCloud(std::vector<OrientedPoint> points);
  PointCloud(PointCloud&&) noexcept;
  PointCloud& operator=(PointCloud&&) noexcept;
  ~PointCloud();
  [[nodiscard]] const std::vector<OrientedPoint>& points() const;
  /// The nearest point, or null when none is within `reach_mm`.
  [[nodiscard]] const OrientedPoint* nearest(const Eigen::Vector2d& at, double reach_mm) const;
  /// Indices of all points within `radius_mm`.
  [[nodiscard]] std::vector<std::size_t> within(const Eigen::Vector2d& at, double radius_mm) const;

 private:
  struct Grid;
  std::unique_ptr<Grid> grid_;
};

/// The rigid motion that brings `from` onto `to` with the least squared distances: centroids subtracted,
/// W = sum to' from'^T = U S V^T, R = U V^T with det +1 (Arun, Huang, Blostein, PAMI 9 (1987)). Precondition:
/// equal numbers, at least two.
Pose2 closed_form_motion(std::span<const Eigen::Vector2d> from, std::span<const Eigen::Vector2d> to);

struct IcpOptions {
  int iterations = 30;
  double reach_mm = 300;          ///< Pairs farther apart than this are never made; tightens as it converges.
  double least_noise_mm = 3;      ///< Robust scale never falls below.
  std::size_t most_points = 400;  ///< Of more, evenly spread ones are used.
  double points_per_fact = 4;     ///< Neighbouring points tell the same: so many count as one.
};

struct IcpResult {
  Pose2 pose;                                                ///< Takes the points into the reference's frame.
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();  ///< mm and rad, about the points' origin.
  double noise_mm = 0;                                       ///< Robust spread of the residuals.
  /// Least over greatest information over directions (heading by the points' mean lever): near 0 in a
  /// corridor, where the match slides.
  double observability = 0;
  std::size_t pairs = 0;
  int iterations = 0;
  bool converged = false;
};

/// How far the guess may be trusted: standard uncertainties. Where the scene tells less than this, the guess
/// rules: the match does not slide along corridors.
struct PosePrior {
  double u_mm = 200, u_rad = 0.2;
};

/// Point-to-line ICP with Cauchy weights, damped by the guess's own information.
IcpResult match_to_lines(const PointCloud& reference, std::span<const Eigen::Vector2d> points,
                         const Pose2& guess, const PosePrior& prior = {}, const IcpOptions& options = {});

/// The paper's baseline: point-to-point ICP with Arun's closed form; no weights, no damping.
IcpResult match_to_points(const PointCloud& reference, std::span<const Eigen::Vector2d> points,
                          const Pose2& guess, const IcpOptions& options = {});

/// A point where odometry puts it in the reference's frame, and how much of the scan had passed when it was
/// taken (0 to 1).
struct SpreadPoint {
  Eigen::Vector2d at_mm = Eigen::Vector2d::Zero();
  double share = 0;
};

/// What odometry got wrong over one scan: so much at its start, and so much more, growing linearly over the
/// beams, at its end. Turns are about `pivot` (where the lidar stood when the scan began).
struct SpreadCorrection {
  Eigen::Vector2d pivot = Eigen::Vector2d::Zero();
  Eigen::Vector3d start = Eigen::Vector3d::Zero(), growth = Eigen::Vector3d::Zero();  ///< mm, mm, rad.

  /// The correction at a share of the scan, as a motion of the reference's frame.
  [[nodiscard]] Pose2 at(double share) const;
  [[nodiscard]] Eigen::Vector2d apply(const SpreadPoint& point) const;
};

struct SpreadPrior {
  Eigen::Matrix3d start_covariance = Eigen::Matrix3d::Identity();  ///< mm and rad.
  Eigen::Vector3d growth_u = Eigen::Vector3d::Ones();
};

struct SpreadResult {
  SpreadCorrection correction;
  Eigen::Matrix3d end_covariance = Eigen::Matrix3d::Identity();  ///< Of the correction at share 1.
  double noise_mm = 0, observability = 0;
  std::size_t pairs = 0;
  int iterations = 0;
  bool converged = false;
};

/// Point-to-line ICP whose correction is spread linearly over the beams, deskewing anew in every iteration
/// (the fusion of Wang et al., source B, with the start of the scan free as well). Weights and damping as in
/// match_to_lines.
SpreadResult match_spread(const PointCloud& reference, std::span<const SpreadPoint> points,
                          const Eigen::Vector2d& pivot, const SpreadPrior& prior,
                          const IcpOptions& options = {});

}  // namespace fit
