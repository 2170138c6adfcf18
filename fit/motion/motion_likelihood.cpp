// SPDX-License-Identifier: MIT
#include "fit/motion/motion_likelihood.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "fit/motion/wheel_time.hpp"
#include "fit/numeric/median.hpp"

namespace fit {

MotionLikelihood::MotionLikelihood(const std::vector<WheelSample>& samples, bool poses)
    : samples_(&samples), poses_(poses) {
  for (std::size_t k = 0; k < samples.size(); ++k)
    follows_.push_back(k > 0 && poses && follows(samples[k - 1], samples[k]));
  for (std::size_t c = 0; c < 3; ++c) {
    rows_[c].resize(samples.size()), at_begin_[c].resize(samples.size()), at_end_[c].resize(samples.size());
    outlier_[c].assign(samples.size(), 0);
  }
}

void MotionLikelihood::linearise(const RobotGeometry& robot) {
  const Steering& steering = steering_of(robot.steering);
  turned_.clear();
  for (std::size_t k = 0; k < samples_->size(); ++k) {
    const WheelSample& sample = (*samples_)[k];
    double turned = 0;
    for (const Eigen::Vector2d& piece : pieces_of(sample)) turned += steering.turned(piece);
    turned_.push_back(turned);
    const Eigen::Vector3d residual = odometry_residual(robot, sample);
    const Eigen::Matrix<double, 3, 6> jacobian = motion_jacobian(robot, sample);
    const Eigen::Vector3d motion(sample.match.x_mm, sample.match.y_mm, sample.match.heading_rad);
    const Eigen::Vector3d speed = (motion - residual) / sample.interval_s;
    for (int c = 0; c < 3; ++c) {
      rows_[c][k] << residual[c], jacobian.row(c).transpose();
      at_begin_[c][k] = at_end_[c][k] = speed[c];
    }
  }
  for (std::size_t k = 1; k < samples_->size(); ++k)
    for (std::size_t c = 0; follows_[k] && c < 3; ++c)
      at_begin_[c][k] = at_end_[c][k - 1] = 0.5 * (at_end_[c][k - 1] + at_end_[c][k]);
}

/// Calls visit(sample, variance, innovation) for the first `columns` of the rows. The state holds the errors
/// of time and of the pose at the end of the sample before: a mean for each column, one covariance.
template <int columns, class Visit>
void MotionLikelihood::filter(std::size_t c, const MotionNoise& noise, Visit visit) const {
  using Means = Eigen::Matrix<double, columns, 1>;
  const MotionNoise::Component& part = noise.of[c];
  Means time = Means::Zero(), pose = Means::Zero();
  double tt = 0, tp = 0, pp = 0;
  double stays = 1, interval_s = 0;
  for (std::size_t k = 0; k < samples_->size(); ++k) {
    const WheelSample& sample = (*samples_)[k];
    if (!follows_[k]) {
      time.setZero(), pose.setZero();
      tt = noise.time, tp = 0, pp = part.pose;
    }
    if (sample.interval_s != interval_s) {
      interval_s = sample.interval_s;
      stays = std::exp(-interval_s / noise.time_lasts_s);
    }
    const double fresh = noise.time * (1 - stays * stays);
    const double u = c == 2 ? sample.relative_u_rad : sample.relative_u_mm;
    const double own = part.sample * u * u + part.walk * turned_[k] + outlier_[c][k];
    // residual = own + end (stays time + fresh) - begin time + new pose - pose.
    const double end = at_end_[c][k], a = end * stays - at_begin_[c][k];
    const double with_time = a * tt - tp, with_pose = a * tp - pp;
    const double variance = own + end * end * fresh + part.pose + a * with_time - with_pose;
    const Means innovation = rows_[c][k].template head<columns>() - a * time + pose;
    visit(k, variance, innovation);
    const double to_time = stays * with_time + end * fresh, to_pose = part.pose;
    time = stays * time + to_time / variance * innovation;
    pose = to_pose / variance * innovation;
    tt = stays * stays * tt + fresh - to_time * to_time / variance;
    tp = -to_time * to_pose / variance;
    pp = part.pose - to_pose * to_pose / variance;
  }
}

double MotionLikelihood::minus_log_likelihood(std::size_t c, const MotionNoise& noise) const {
  double sum = 0, product = 1;
  filter<1>(c, noise, [&](std::size_t k, double variance, const Eigen::Matrix<double, 1, 1>& innovation) {
    sum += 0.5 * innovation[0] * innovation[0] / variance;
    product *= variance;  // One logarithm for eight.
    if (k % 8 == 0) sum += 0.5 * std::log(std::exchange(product, 1));
  });
  return sum + 0.5 * std::log(product);
}

void MotionLikelihood::raise_outliers(std::size_t c) {
  constexpr double beyond = 6;
  std::vector<double> added(samples_->size());
  filter<1>(c, noise_, [&](std::size_t k, double variance, const Eigen::Matrix<double, 1, 1>& innovation) {
    const double square = innovation[0] * innovation[0];
    const double without = variance - outlier_[c][k];
    if (square > beyond * beyond * without) added[k] = square - without;
  });
  outlier_[c] = std::move(added);
}

MotionNoise::Component MotionLikelihood::first_guess(std::size_t c) const {
  std::vector<double> squares, turned = turned_;
  for (const Row& row : rows_[c]) squares.push_back(row[0] * row[0]);
  const double all = std::max(1e-18, median_of(squares) / median_of_normal_squares);
  if (!poses_) return {all, 0, 0};
  return {all / 3, all / (3 * std::max(1e-9, median_of(turned))), all / 3};
}

/// Logarithms are searched by pattern (Hooke and Jeeves, J. ACM 8 (1961)).
void MotionLikelihood::estimate_noise() {
  struct Sought {
    double* value;
    double least, most;
    std::size_t first, last;  ///< Components that it counts in.
  };
  std::vector<Sought> all;
  for (std::size_t c = 0; c < 3; ++c) {
    // What is a millionth of the first guess is none.
    const MotionNoise::Component guess = first_guess(c);
    MotionNoise::Component& now = noise_.of[c];
    if (!(now.sample > 0)) now = guess;
    all.push_back({&now.sample, 1e-6 * guess.sample, 1e300, c, c});
    if (!poses_) continue;
    all.push_back({&now.walk, 1e-6 * guess.walk, 1e300, c, c});
    all.push_back({&now.pose, 1e-6 * guess.pose, 1e300, c, c});
  }
  if (poses_) {
    if (!(noise_.time > 0)) noise_.time = 1e-4;
    all.push_back({&noise_.time, 1e-10, 1, 0, 2});
    all.push_back({&noise_.time_lasts_s, 0.01, 1000, 0, 2});
  }
  std::array<double, 3> best{};
  for (std::size_t c = 0; c < 3; ++c) {
    raise_outliers(c);
    best[c] = minus_log_likelihood(c, noise_);
  }
  for (double step = 4; step > 1.02;) {
    bool better = false;
    for (const Sought& one : all)
      for (const double by : {step, 1 / step}) {
        const double before = *one.value;
        *one.value = std::clamp(before * by, one.least, one.most);
        std::array<double, 3> its = best;
        double gain = 0;
        for (std::size_t c = one.first; c <= one.last; ++c) {
          its[c] = minus_log_likelihood(c, noise_);
          gain += best[c] - its[c];
        }
        if (gain > 1e-6) {
          best = its, better = true;
          break;
        }
        *one.value = before;
      }
    if (!better) step = std::sqrt(step);
  }
}

std::vector<MotionEquations> MotionLikelihood::equations(const std::vector<std::size_t>& groups) const {
  std::vector<MotionEquations> out(groups.empty() ? 0 : *std::ranges::max_element(groups) + 1);
  for (const std::size_t group : groups) ++out[group].samples;
  for (std::size_t c = 0; c < 3; ++c)
    filter<7>(c, noise_, [&](std::size_t k, double variance, const Row& row) {
      const auto j = row.tail<6>();
      out[groups[k]].information += j * j.transpose() / variance;
      out[groups[k]].gradient += j * (row[0] / variance);
    });
  return out;
}

}  // namespace fit
