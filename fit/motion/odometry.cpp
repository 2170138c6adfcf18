// SPDX-License-Identifier: MIT
#include "fit/motion/odometry.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <limits>
#include <numeric>
#include <stdexcept>

#include "fit/numeric/dense.hpp"
#include "fit/numeric/distributions.hpp"

namespace fit {
namespace {

using Vector5 = Eigen::Matrix<double, 5, 1>;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Indices = std::vector<std::size_t>;

/// sin(a)/a and (1-cos(a))/a, also at 0.
std::pair<double, double> arc_factors(double a) {
  if (std::abs(a) < 1e-6) return {1 - a * a / 6, a / 2};
  return {std::sin(a) / a, (1 - std::cos(a)) / a};
}

/// The wheels' motion over a sample, piece by piece.
template <class Visit>
void for_each_piece(const WheelSample& sample, Visit visit) {
  if (sample.pieces.empty())
    return visit(
        Eigen::Vector2d(sample.left_rad_s * sample.interval_s, sample.right_rad_s * sample.interval_s));
  for (const Eigen::Vector2d& piece : sample.pieces) visit(piece);
}

/// The gains by which the wheels turn the robot (two driven wheels: J21, J22, the second row of the wheels'
/// Jacobian) and their covariance per unit of heading variance.
struct TurnGains {
  Eigen::Vector2d gain;
  Eigen::Matrix2d cofactor;
};

TurnGains fit_turn_gains(const std::vector<WheelSample>& samples, const Indices& used,
                         const Steering& steering) {
  Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
  Eigen::Vector2d right = Eigen::Vector2d::Zero();
  for (const std::size_t k : used) {
    const WheelSample& s = samples[k];
    Eigen::Vector2d row = Eigen::Vector2d::Zero();
    for_each_piece(s, [&](const Eigen::Vector2d& piece) { row += steering.turn_row(piece); });
    const double weight = 1 / (s.relative_u_rad * s.relative_u_rad);
    normal += weight * row * row.transpose();
    right += weight * row * s.match.heading_rad;
  }
  const Eigen::Matrix2d cofactor = dense::pseudo_inverse(normal);
  return {cofactor * right, cofactor};
}

/// The quadratic form of l (+) s = r (+) l in (b, l_x, l_y, cos l_theta, sin l_theta).
Eigen::Matrix<double, 5, 5> quadratic_form(const std::vector<WheelSample>& samples, const Indices& used,
                                           const Eigen::Vector2d& gain, const Steering& steering) {
  // With the gains known, the robot's way is proportional to its base.
  RobotGeometry of_base_1;
  of_base_1.steering = &steering;
  const Eigen::Vector3d wheels = steering.parameters_of(gain, 1);
  of_base_1.left_radius_mm = wheels[0], of_base_1.right_radius_mm = wheels[1], of_base_1.separation_mm = 1;
  Eigen::Matrix<double, 5, 5> form = Eigen::Matrix<double, 5, 5>::Zero();
  for (const std::size_t k : used) {
    const WheelSample& s = samples[k];
    const Pose2 unit = wheel_motion(of_base_1, s);
    const double c = std::cos(unit.heading_rad), sn = std::sin(unit.heading_rad);
    Vector5 x, y;
    x << -unit.x_mm, 1 - c, sn, s.match.x_mm, -s.match.y_mm;
    y << -unit.y_mm, -sn, 1 - c, s.match.y_mm, s.match.x_mm;
    form += (x * x.transpose() + y * y.transpose()) / (s.relative_u_mm * s.relative_u_mm);
  }
  return form;
}

/// Minimum of the form under cos^2 + sin^2 = 1: the first three unknowns are eliminated, and of the 2 x 2
/// form that remains the eigenvector of the smaller eigenvalue (the smaller Lagrange multiplier) is the
/// minimum, the other one a saddle. The sign is the one with a positive separation.
RobotGeometry solve_constrained(const Eigen::Matrix<double, 5, 5>& form, const Eigen::Vector2d& gain,
                                const Steering& steering) {
  const Eigen::Matrix<double, 3, 3> head = form.topLeftCorner<3, 3>();
  const Eigen::Matrix<double, 3, 2> mixed = form.topRightCorner<3, 2>();
  const Eigen::Matrix3d head_inverse = dense::pseudo_inverse(head);
  const Eigen::Matrix<double, 3, 2> eliminated = head_inverse * mixed;
  const Eigen::Matrix2d rest = form.bottomRightCorner<2, 2>() - mixed.transpose() * eliminated;
  Eigen::Vector2d direction = dense::symmetric_eigen(0.5 * (rest + rest.transpose())).vectors.col(0);
  Eigen::Vector3d others = -eliminated * direction;
  if (others[0] < 0) {
    direction = -direction;
    others = -others;
  }
  RobotGeometry robot;
  robot.steering = &steering;
  const Eigen::Vector3d wheels = steering.parameters_of(gain, others[0]);
  robot.left_radius_mm = wheels[0], robot.right_radius_mm = wheels[1], robot.separation_mm = wheels[2];
  robot.lidar = {others[1], others[2], std::atan2(direction[1], direction[0])};
  return robot;
}

RobotGeometry solve_closed_form(const std::vector<WheelSample>& samples, const Indices& used,
                                const Steering& steering) {
  const TurnGains gains = fit_turn_gains(samples, used, steering);
  return solve_constrained(quadratic_form(samples, used, gains.gain, steering), gains.gain, steering);
}

Eigen::Vector3d in_own_units(const Eigen::Vector3d& residual, const WheelSample& s) {
  return {residual[0] / s.relative_u_mm, residual[1] / s.relative_u_mm, residual[2] / s.relative_u_rad};
}

Eigen::Vector3d residual_rms(const std::vector<WheelSample>& samples, const Indices& used,
                             const RobotGeometry& robot) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const std::size_t k : used)
    sum += in_own_units(odometry_residual(robot, samples[k]), samples[k]).cwiseAbs2();
  return (sum / static_cast<double>(used.size())).cwiseSqrt();
}

struct NormalEquations {
  Matrix6 information = Matrix6::Zero();
  Vector6 gradient = Vector6::Zero();
};

NormalEquations linearise(const std::vector<WheelSample>& samples, const Indices& used,
                          const RobotGeometry& robot, const Eigen::Vector3d& noise) {
  NormalEquations out;
  for (const std::size_t k : used) {
    const WheelSample& s = samples[k];
    const Eigen::Vector3d scale(1 / (noise[0] * s.relative_u_mm), 1 / (noise[1] * s.relative_u_mm),
                                1 / (noise[2] * s.relative_u_rad));
    const Eigen::Matrix<double, 3, 6> j = scale.asDiagonal() * motion_jacobian(robot, s);
    out.information += j.transpose() * j;
    out.gradient += j.transpose() * (scale.asDiagonal() * odometry_residual(robot, s));
  }
  return out;
}

/// Gauss-Newton on all six parameters; keeps the start if that does not help.
RobotGeometry refine(const std::vector<WheelSample>& samples, const Indices& used, RobotGeometry robot,
                     const Eigen::Vector3d& noise) {
  for (int round = 0; round < 20; ++round) {
    const NormalEquations at = linearise(samples, used, robot, noise);
    const Vector6 step = dense::solve_symmetric(at.information, at.gradient);
    if (!step.allFinite()) return robot;
    robot = RobotGeometry::from(robot.vector() + step, robot.steering);
    if (step.transpose() * at.information * step < 1e-10) break;
  }
  return robot;
}

/// How much smaller the variance of a Gaussian with three components gets when all but the best `share` of
/// the samples by chi are dropped (truncated chi-squared).
double trimmed_variance(double share) {
  if (share >= 1) return 1;
  return chi_squared_cdf(5, chi_squared_quantile(3, share)) / share;
}

Matrix6 inverse_information(const Matrix6& information, const Vector6& scale) {
  const dense::SymmetricEigen eigen =
      dense::symmetric_eigen(scale.asDiagonal() * information * scale.asDiagonal());
  Matrix6 inverse = Matrix6::Zero();
  for (int i = 0; i < 6; ++i) {
    const double value = std::max(eigen.values[i], 1e-12);
    inverse += eigen.vectors.col(i) * eigen.vectors.col(i).transpose() / value;
  }
  return scale.asDiagonal() * inverse * scale.asDiagonal();
}

/// Sizes at which an uncertainty makes a parameter worthless: a tenth of a wheel or base, 30 mm, 5 degrees.
Vector6 worthless(const RobotGeometry& robot) {
  const Steering& steering = steering_of(robot.steering);
  const Vector6 at = robot.vector();
  Vector6 scale;
  for (int i = 0; i < 3; ++i) {
    const bool angle = steering.parameters[static_cast<std::size_t>(i)].unit == "deg";
    scale[i] = angle ? 5 * rad_per_deg : 0.1 * std::max(1.0, std::abs(at[i]));
  }
  scale.tail<3>() << 30, 30, 5 * rad_per_deg;
  return scale;
}

MotionShares judge_motion(const std::vector<WheelSample>& samples, const Indices& used,
                          const RobotGeometry& robot, const Eigen::Vector3d& noise) {
  const Steering& steering = steering_of(robot.steering);
  MotionShares shares;
  const double one = 1.0 / static_cast<double>(used.size());
  for (const std::size_t k : used) {
    // The wheels tell how the robot moved even where its geometry is not known: by the ratio of their speeds.
    const WheelSample& s = samples[k];
    double turned = 0, curving = 0;
    for_each_piece(s, [&](const Eigen::Vector2d& piece) {
      turned += steering.turned(piece);
      curving += steering.turned(piece) * steering.curving(piece);
    });
    curving = turned > 0 ? curving / turned : 0;
    if (s.match.position().norm() < 3 * std::max(noise[0], noise[1]) &&
        std::abs(s.match.heading_rad) < 3 * noise[2])
      shares.still += one;
    else if (curving < 0.05)
      shares.straight += one;
    else if (curving > 0.95)
      shares.on_the_spot += one;
    else
      shares.curve += one;
  }
  return shares;
}

std::string remedy(const MotionShares& motion) {
  if (motion.still > 0.9) return "The robot barely moved: drive it.";
  if (motion.straight > 0.9 * (1 - motion.still))
    return "The robot drove only straight: then the lidar's position and how the wheels turn the robot leave "
           "no trace. Add curves and turns on the spot, both ways.";
  if (motion.on_the_spot > 0.9 * (1 - motion.still))
    return "The robot only turned on the spot. Wheel size and separation cannot be distinguished then, nor "
           "the "
           "lidar's yaw from the direction of its offset. Add straight stretches.";
  return "Drive longer, with straight stretches and turns both ways, in a scene that is not a bare corridor.";
}

Indices without_worst(const std::vector<WheelSample>& samples, const Indices& used,
                      const OdometryRound& round, double share) {
  std::vector<std::pair<double, std::size_t>> chi;
  for (const std::size_t k : used) {
    const Eigen::Vector3d e = in_own_units(odometry_residual(round.robot, samples[k]), samples[k]);
    chi.emplace_back(e.cwiseQuotient(round.residual_rms.cwiseMax(1e-12)).squaredNorm(), k);
  }
  std::sort(chi.begin(), chi.end());
  const double keep = static_cast<double>(used.size()) * (1 - share);
  chi.resize(std::max<std::size_t>(20, static_cast<std::size_t>(keep)));
  Indices left;
  for (const auto& [value, k] : chi) left.push_back(k);
  std::sort(left.begin(), left.end());
  return left;
}

}  // namespace

Eigen::Vector3d residual_rms(const std::vector<WheelSample>& samples, const RobotGeometry& robot) {
  Indices all(samples.size());
  std::iota(all.begin(), all.end(), 0);
  return residual_rms(samples, all, robot);
}

Eigen::Matrix<double, 6, 1> RobotGeometry::vector() const {
  Vector6 v;
  v << left_radius_mm, right_radius_mm, separation_mm, lidar.x_mm, lidar.y_mm, lidar.heading_rad;
  return v;
}

RobotGeometry RobotGeometry::from(const Vector6& v, const Steering* steering) {
  return {v[0], v[1], v[2], {v[3], v[4], v[5]}, steering};
}

Pose2 wheel_motion(const RobotGeometry& robot, const WheelSample& sample) {
  const Steering& steering = steering_of(robot.steering);
  const Eigen::Vector2d gains =
      steering.gains_of({robot.left_radius_mm, robot.right_radius_mm, robot.separation_mm});
  Pose2 motion;
  for_each_piece(sample, [&](const Eigen::Vector2d& piece) {
    const double turn = steering.turn_row(piece).dot(gains);
    const double way = robot.separation_mm * steering.way_row(piece).dot(gains);
    const auto [along, across] = arc_factors(turn);
    motion = motion * Pose2{way * along, way * across, turn};
  });
  return motion;
}

Pose2 lidar_motion(const RobotGeometry& robot, const WheelSample& sample) {
  return robot.lidar.inverse() * wheel_motion(robot, sample) * robot.lidar;
}

Eigen::Vector3d odometry_residual(const RobotGeometry& robot, const WheelSample& sample) {
  const Pose2 predicted = lidar_motion(robot, sample);
  return {sample.match.x_mm - predicted.x_mm, sample.match.y_mm - predicted.y_mm,
          wrap_angle(sample.match.heading_rad - predicted.heading_rad)};
}

Eigen::Matrix<double, 3, 6> motion_jacobian(const RobotGeometry& robot, const WheelSample& sample) {
  Eigen::Matrix<double, 3, 6> jacobian;
  const Vector6 at = robot.vector();
  const Pose2 wheels = wheel_motion(robot, sample);
  for (int i = 0; i < 6; ++i) {
    const double step = i < 5 ? 1e-4 : 1e-6;
    // The lidar's place does not change what the wheels do.
    const auto moved = [&](double by) {
      Vector6 v = at;
      v[i] += by;
      const RobotGeometry other = RobotGeometry::from(v, robot.steering);
      return other.lidar.inverse() * (i < 3 ? wheel_motion(other, sample) : wheels) * other.lidar;
    };
    const Pose2 a = moved(step), b = moved(-step);
    jacobian.col(i) =
        Eigen::Vector3d(a.x_mm - b.x_mm, a.y_mm - b.y_mm, a.heading_rad - b.heading_rad) / (2 * step);
  }
  return jacobian;
}

Matrix6 covariance_of_robot(const Matrix6& information, const RobotGeometry& robot) {
  return inverse_information(information, worthless(robot));
}

Vector6 damped_step(const Matrix6& information, const Vector6& gradient, const RobotGeometry& robot) {
  const Vector6 least = worthless(robot).cwiseAbs2().cwiseInverse();
  const Matrix6 damped = information + Matrix6(least.asDiagonal());
  return dense::solve_symmetric(damped, gradient);
}

void judge_determined(OdometryFit& fit, bool turns_unknown) {
  std::vector<std::string> names;
  for (const Steering::Parameter& p : steering_of(fit.robot.steering).parameters) {
    names.push_back(p.label);
    names.back()[0] = static_cast<char>(std::tolower(static_cast<unsigned char>(names.back()[0])));
  }
  names.insert(names.end(), {"lidar's x", "lidar's y", "lidar's yaw"});
  const Vector6 limit = worthless(fit.robot);
  std::string weak;
  for (std::size_t i = 0; i < 6; ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    fit.determined[i] = std::sqrt(fit.covariance(k, k)) < limit[k] && !(turns_unknown && i < 3);
    if (!fit.determined[i]) weak += (weak.empty() ? "" : ", ") + names[i];
  }
  bool impossible = false;
  for (int i = 0; i < 3; ++i)
    impossible =
        impossible || (steering_of(fit.robot.steering).parameters[static_cast<std::size_t>(i)].unit == "mm" &&
                       !(fit.robot.vector()[i] > 0));
  fit.undetermined.clear();
  if (!weak.empty())
    fit.undetermined = {"These samples do not determine: " + weak + ". " + remedy(fit.motion)};
  else if (impossible)
    fit.undetermined = {
        "The fit gives a wheel of negative size: left and right wheel are swapped, or a sign is."};
}

OdometryFit fit_odometry(const std::vector<WheelSample>& samples, const OdometryOptions& options) {
  if (samples.size() < 20)
    throw std::invalid_argument("at least 20 samples are needed, not " + std::to_string(samples.size()));
  OdometryFit fit;
  const Steering& steering = steering_of(options.steering);
  Indices used(samples.size());
  std::iota(used.begin(), used.end(), 0);
  Indices after_first = used;
  for (int round = 0; round <= options.rounds; ++round) {
    OdometryRound now;
    now.samples = used.size();
    now.robot = solve_closed_form(samples, used, steering);
    now.residual_rms = residual_rms(samples, used, now.robot);
    if (options.refine && round == options.rounds) {
      now.robot = refine(samples, used, now.robot, now.residual_rms.cwiseMax(1e-12));
      now.residual_rms = residual_rms(samples, used, now.robot);
    }
    fit.rounds.push_back(now);
    if (round == 1) after_first = used;
    if (round < options.rounds) used = without_worst(samples, used, now, options.outlier_share);
  }
  fit.robot = fit.rounds.back().robot;
  const double kept = static_cast<double>(used.size()) / static_cast<double>(samples.size());
  fit.noise = fit.rounds.back().residual_rms.cwiseMax(1e-9) / std::sqrt(trimmed_variance(kept));
  fit.covariance = covariance_of_robot(linearise(samples, used, fit.robot, fit.noise).information, fit.robot);
  const Eigen::Vector3d early =
      residual_rms(samples, after_first, fit.rounds[fit.rounds.size() > 1 ? 1 : 0].robot);
  fit.first_round_covariance =
      covariance_of_robot(linearise(samples, used, fit.robot, early.cwiseMax(1e-9)).information, fit.robot);
  fit.used.assign(samples.size(), false);
  for (const std::size_t k : used) fit.used[k] = true;
  fit.motion = judge_motion(samples, used, fit.robot, fit.noise);
  const TurnGains turns = fit_turn_gains(samples, used, steering);
  const double turn_u = fit.noise[2] * std::sqrt(turns.cofactor.diagonal().maxCoeff());
  judge_determined(
      fit, !(turns.cofactor.diagonal().minCoeff() > 0) || turn_u > 0.1 * turns.gain.cwiseAbs().maxCoeff());
  return fit;
}

}  // namespace fit
