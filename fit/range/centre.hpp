// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "fit/range/edge.hpp"

namespace fit {

/// The stage's axis in the lidar's frame, from one physical point seen as `before` and, after the lidar
/// turned counter-clockwise by `turn_rad`, as `after`. Source A, experiment A5, corrected form (the printed
/// one loses the midpoint and a sign). Throws std::invalid_argument when the turn is a multiple of 2 pi.
[[nodiscard]] Eigen::Vector2d centre_from_pair(const Eigen::Vector2d& before, const Eigen::Vector2d& after,
                                               double turn_rad);

/// One sight of the common point.
struct CentrePoint {
  double stage_rad = 0;
  double beam_rad = 0;
  double range_mm = 0;
  double u_range_mm = 0;
  double u_angle_rad = 0;  ///< Of beam and stage angle together.
  std::string label;
  [[nodiscard]] Eigen::Vector2d position() const {
    return {range_mm * std::cos(beam_rad), range_mm * std::sin(beam_rad)};
  }
};

/// A systematic deviation that all sights have in common.
struct CentreEffect {
  std::string name;
  /// How one standard uncertainty of it moves every sight: radially and tangentially, mm.
  std::vector<Eigen::Vector2d> shift_mm;
};

struct CentrePair {
  std::size_t first = 0, second = 0;
  double turn_rad = 0;
  Eigen::Vector2d centre;
  Eigen::Matrix2d covariance;
};

/// The centre from two sights with its covariance; small turns make it large.
[[nodiscard]] CentrePair centre_of_pair(const std::vector<CentrePoint>& points, std::size_t first,
                                        std::size_t second, const std::vector<CentreEffect>& effects = {});

/// The mean of pairs' centres, in mm; pairs that share a sight go together in its covariance.
struct CentreMean {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
};
[[nodiscard]] CentreMean mean_of_pairs(const std::vector<CentrePoint>& points,
                                       const std::vector<CentrePair>& pairs,
                                       const std::vector<CentreEffect>& effects = {});

struct CentreFit {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
  Eigen::Matrix2d from_range = Eigen::Matrix2d::Zero(), from_angle = Eigen::Matrix2d::Zero();  ///< Its parts.
  std::vector<Eigen::Matrix2d> angle_parts;  ///< What each sight's angle adds to from_angle.
  std::vector<Eigen::Vector2d> effects;  ///< What one standard uncertainty of each effect does to the centre.
  Eigen::Vector2d point = Eigen::Vector2d::Zero();  ///< The common point, from the centre, at stage angle 0.
  std::vector<Eigen::Vector2d> residuals;           ///< Radial and tangential, mm.
  double chi2 = 0;
  int degrees_of_freedom = 0;
  double inflation = 1;  ///< The covariance was widened by its square: the residuals were improbably large.
  double condition = 1;  ///< Of the weighted design, columns scaled to unit length.
};

/// All sights at once: p_i = R(-stage_i) point + centre, generalised least squares (linear in point and
/// centre); the effects make the sights' errors go together. Throws std::invalid_argument with fewer than two
/// sights or without any turn between them.
[[nodiscard]] CentreFit fit_centre(const std::vector<CentrePoint>& points,
                                   const std::vector<CentreEffect>& effects = {});

/// A board seen as a line from one stage position: normal angle and distance in the lidar's frame.
struct BoardLine {
  double stage_rad = 0;
  double normal_rad = 0, distance_mm = 0;
  double u_distance_mm = 0;
  long beams = 0;
};
/// A systematic deviation of all lines: how one standard uncertainty of it changes every distance, mm.
struct LineEffect {
  std::string name;
  std::vector<double> shift_mm;
};

/// The centre from the board's distance alone: d_i = d_0 + n_i . centre, where n_i is the board's normal in
/// the lidar's frame. Independent of the edge; a constant range error falls into d_0. Needs three positions
/// or more; same errors as fit_centre.
[[nodiscard]] CentreFit fit_centre_from_lines(const std::vector<BoardLine>& lines,
                                              const std::vector<LineEffect>& effects = {});

/// A robot's pose in the map.
struct RobotPose {
  double x_mm = 0, y_mm = 0, heading_rad = 0;
};

/// A point of the lidar's frame relative to the rotation centre.
[[nodiscard]] Eigen::Vector2d about_centre(const Eigen::Vector2d& point, const Eigen::Vector2d& centre);

/// The point that a corrected range at beam angle `beam_rad` has in the map, for a lidar mounted at `mount`
/// on a robot that turns about the centre: R(heading) (L cos a + x_s - x_o, L sin a + y_s - y_o) + (x_r,
/// y_r). Source A, equations 13 and 17, corrected: the centre turns with the lidar.
[[nodiscard]] Eigen::Vector2d to_map(double corrected_mm, double beam_rad, const Eigen::Vector2d& mount,
                                     const Eigen::Vector2d& centre, const RobotPose& robot);

}  // namespace fit
