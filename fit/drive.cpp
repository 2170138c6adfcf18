// SPDX-License-Identifier: MIT
#include "fit/drive.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <optional>
#include <stdexcept>

namespace fit {
namespace {

using Eigen::Vector2d;
using Vector6 = Eigen::Matrix<double, 6, 1>;

/// Wheel angles in order of time.
class Wheels {
 public:
  explicit Wheels(const std::vector<TrackPose>& track) {
    for (const TrackPose& pose : track)
      if (pose.wheel_left_rad && pose.wheel_right_rad)
        known_.push_back(
            {static_cast<double>(pose.host_us) * 1e-6, {*pose.wheel_left_rad, *pose.wheel_right_rad}});
    std::ranges::stable_sort(known_, {}, &At::time_s);
    const auto same_time = [](const At& a, const At& b) { return a.time_s == b.time_s; };
    known_.erase(std::unique(known_.begin(), known_.end(), same_time), known_.end());
  }
  [[nodiscard]] std::size_t size() const { return known_.size(); }
  [[nodiscard]] bool covers(double from, double to) const {
    return size() >= 2 && from >= known_.front().time_s && to <= known_.back().time_s;
  }
  [[nodiscard]] Vector2d at(double time_s) const {
    const auto b = after(time_s), a = b - 1;
    return a->angle + (time_s - a->time_s) / (b->time_s - a->time_s) * (b->angle - a->angle);
  }
  /// How far the wheels turned in each interval between the known times from `from` to `to`.
  [[nodiscard]] std::vector<Vector2d> pieces(double from, double to) const {
    std::vector<Vector2d> out;
    Vector2d last = at(from);
    for (auto it = after(from); it != known_.end() && it->time_s < to; ++it) {
      out.push_back(it->angle - last);
      last = it->angle;
    }
    out.push_back(at(to) - last);
    return out;
  }

 private:
  struct At {
    double time_s;
    Vector2d angle;
  };
  [[nodiscard]] std::vector<At>::const_iterator after(double time_s) const {
    return std::upper_bound(known_.begin() + 1, known_.end() - 1, time_s,
                            [](double t, const At& at) { return t < at.time_s; });
  }
  std::vector<At> known_;
};

WheelSample sample_between(const Wheels& wheels, double from, double to) {
  WheelSample sample;
  sample.begin_s = from;
  sample.interval_s = to - from;
  sample.pieces = wheels.pieces(from, to);
  const Vector2d turned = wheels.at(to) - wheels.at(from);
  sample.left_rad_s = turned.x() / sample.interval_s;
  sample.right_rad_s = turned.y() / sample.interval_s;
  return sample;
}

/// A scan in the lidar's frame at the middle of its sweep.
struct Still {
  double time_s = 0;  ///< On the wheels' clock.
  std::vector<Vector2d> points;
  PointCloud cloud;
};

class Drive {
 public:
  Drive(const Recording& recording, const DriveOptions& options)
      : options_(options), wheels_(recording.track()) {
    for (std::size_t i = 0; i < recording.captures().size(); ++i)
      recording.for_each_scan(i, [&](const ScanView& scan) {
        sweeps_.push_back(sweep_of(scan, recording.captures()[i], recording.bench().lidar));
      });
    std::ranges::stable_sort(sweeps_, {}, &Sweep::begin_s);
    if (wheels_.size() < 10)
      throw std::invalid_argument(
          "The session holds no wheel angles. Import the recording with its joint states (rig import), or "
          "give "
          "tuple files");
    if (sweeps_.size() < 20)
      throw std::invalid_argument("The session holds only " + std::to_string(sweeps_.size()) +
                                  " scans: a drive of at least a minute is needed");
    const Mount& mount = recording.bench().lidar.mount;
    lidar_ = {mount.x_mm.value, mount.y_mm.value, mount.yaw_rad.value};
    const bool odometry =
        std::ranges::any_of(recording.track(), [](const TrackPose& p) { return p.x_mm && p.heading_rad; });
    if (odometry) {
      path_ = carrier_of(recording).path;
    } else if (options.guess.separation_mm > 0) {
      path_ = path_from_wheels(recording.track(), options.guess);
    } else {
      throw std::invalid_argument(
          "The session holds no odometry to start from. Give the nominal wheels with the options "
          "wheel_radius_mm "
          "and separation_mm");
    }
  }

  DriveFit run(const Recording& recording) {
    DriveFit out;
    out.timing = estimate_timing(sweeps_, path_, lidar_, {options_.widest_offset_s, std::nullopt, true});
    timing_ = out.timing.timing;
    if (!out.timing.determined) timing_.offset_s = 0;
    for (int round = 0; round < options_.rounds; ++round) {
      deskew_all();
      collect(out);
      if (out.samples.size() < 20)
        throw std::invalid_argument(
            "Only " + std::to_string(out.samples.size()) +
            " pairs of scans could be matched while the robot moved (" + std::to_string(out.bad_matches) +
            " were left out as doubtful): at least 20 are needed, and some hundreds for a "
            "good result. Drive longer, within sight of walls");
      out.odometry = fit_odometry(out.samples, options_.fit);
      find_offset(out);
      out.rounds.push_back(out.odometry.robot);
      const bool usable = out.odometry.robot.separation_mm > 0 && out.odometry.robot.left_radius_mm > 0 &&
                          out.odometry.robot.right_radius_mm > 0 && out.odometry.undetermined.empty();
      if (!usable) break;
      lidar_ = out.odometry.robot.lidar;
      path_ = path_from_wheels(recording.track(), out.odometry.robot);
    }
    widen(out);
    return out;
  }

 private:
  /// Shifts the wheels' time to where wheels and matches agree best; they are much the better clock than the
  /// agreement of scans. The samples are made anew there.
  void find_offset(DriveFit& out) {
    constexpr int half = 30;
    constexpr double step_s = 0.01;
    std::vector<double> cost;
    for (int k = -half; k <= half; ++k) {
      const auto shifted = shift(out.samples, k * step_s);
      cost.push_back(shifted.empty() ? 1e18 : disagreement(shifted, out.odometry.noise));
    }
    const auto best = std::ranges::min_element(cost) - cost.begin();
    if (best < 2 || best + 2 >= static_cast<std::ptrdiff_t>(cost.size())) return;
    const auto at = static_cast<std::size_t>(best);
    const double bend = (cost[at + 2] - 2 * cost[at] + cost[at - 2]) / (4 * step_s * step_s);
    const double slope = (cost[at + 2] - cost[at - 2]) / (4 * step_s);
    if (!(bend > 0) || cost[at + 2] > 1e17 || cost[at - 2] > 1e17) return;
    const double move =
        (static_cast<double>(best) - half) * step_s - std::clamp(slope / bend, -step_s, step_s);
    out.samples = shift(out.samples, move);
    timing_.offset_s += move;
    out.offset_s = {timing_.offset_s, std::sqrt(2 / bend)};
    out.odometry = fit_odometry(out.samples, options_.fit);
  }

  /// The same matches with the wheels' angles at other times; empty when the wheels do not cover them.
  [[nodiscard]] std::vector<WheelSample> shift(const std::vector<WheelSample>& samples, double by_s) const {
    std::vector<WheelSample> out;
    for (const WheelSample& old : samples) {
      const double from = old.begin_s + by_s, to = from + old.interval_s;
      if (!wheels_.covers(from, to)) return {};
      out.push_back(sample_between(wheels_, from, to));
      out.back().match = old.match;
    }
    return out;
  }

  /// Sum of squared residuals of the closed form's fit in units of `noise`, each bounded.
  [[nodiscard]] double disagreement(const std::vector<WheelSample>& samples,
                                    const Eigen::Vector3d& noise) const {
    OdometryOptions quick = options_.fit;
    quick.refine = false;
    const RobotGeometry robot = fit_odometry(samples, quick).robot;
    double sum = 0;
    for (const WheelSample& sample : samples)
      sum += std::min(16.0, odometry_residual(robot, sample).cwiseQuotient(noise).squaredNorm());
    return sum;
  }

  void deskew_all() {
    stills_.clear();
    for (const Sweep& sweep : sweeps_) {
      Still still;
      still.time_s = timing_.path_time(sweep, 0.5);
      still.points = deskew(sweep, path_, lidar_, timing_, 0.5);
      still.cloud = PointCloud(orient_sweep(still.points));
      stills_.push_back(std::move(still));
    }
  }

  /// Motion of the lidar from one scan to another, from matching both onto each other.
  [[nodiscard]] std::optional<Pose2> match(const Still& a, const Still& b) const {
    const Pose2 guess = (path_.at(a.time_s) * lidar_).inverse() * (path_.at(b.time_s) * lidar_);
    const PosePrior weak{100, 0.1};
    const IcpResult there = match_to_lines(a.cloud, b.points, guess, weak);
    const IcpResult back = match_to_lines(b.cloud, a.points, guess.inverse(), weak);
    const std::size_t least = std::min(a.points.size(), b.points.size()) / 3;
    if (!there.converged || !back.converged || there.pairs < least || back.pairs < least) return std::nullopt;
    if (std::min(there.observability, back.observability) < 0.02) return std::nullopt;
    const Pose2 other = back.pose.inverse();
    if ((there.pose.position() - other.position()).norm() > 30 ||
        std::abs(wrap_angle(there.pose.heading_rad - other.heading_rad)) > 1.5 * rad_per_deg)
      return std::nullopt;
    return interpolate(there.pose, other, 0.5);
  }

  [[nodiscard]] bool rests(double from, double to) const {
    return (wheels_.at(to) - wheels_.at(from)).cwiseAbs().maxCoeff() < 0.02;
  }

  [[nodiscard]] bool far_enough(double from, double to) const {
    const Pose2 motion = path_.at(from).inverse() * path_.at(to);
    return motion.position().norm() >= options_.least_way_mm ||
           std::abs(motion.heading_rad) >= options_.least_turn_rad;
  }

  /// From every scan to the first one far enough away.
  void collect(DriveFit& out) {
    out.samples.clear();
    out.still_s = out.moving_s = 0;
    out.still_matches = out.bad_matches = 0;
    out.still_noise.setZero();
    for (std::size_t i = 0; i + 1 < stills_.size(); ++i) {
      const double from = stills_[i].time_s;
      if (!wheels_.covers(from, stills_[i + 1].time_s)) continue;
      const double step = stills_[i + 1].time_s - from;
      if (step > 0.5 * options_.longest_s) continue;  // a gap between recordings
      if (rests(from, stills_[i + 1].time_s)) {
        out.still_s += step;
        standing_pair(i, out);
        continue;
      }
      out.moving_s += step;
      std::size_t j = i + 1;
      while (j + 1 < stills_.size() && stills_[j].time_s - from < options_.longest_s &&
             !far_enough(from, stills_[j].time_s))
        ++j;
      const double to = stills_[j].time_s;
      if (!wheels_.covers(from, to) || to - from > 1.5 * options_.longest_s) continue;
      const auto motion = match(stills_[i], stills_[j]);
      if (!motion) {
        ++out.bad_matches;
        continue;
      }
      WheelSample sample = sample_between(wheels_, from, to);
      sample.match = *motion;
      out.samples.push_back(std::move(sample));
    }
    if (out.still_matches > 0)
      out.still_noise = (out.still_noise / static_cast<double>(out.still_matches)).cwiseSqrt().eval();
  }

  void standing_pair(std::size_t i, DriveFit& out) {
    const std::size_t j = i + 4;
    if (i % 4 != 0 || j >= stills_.size() || !wheels_.covers(stills_[i].time_s, stills_[j].time_s) ||
        !rests(stills_[i].time_s, stills_[j].time_s))
      return;
    if (const auto motion = match(stills_[i], stills_[j])) {
      out.still_noise += Eigen::Vector3d(motion->x_mm, motion->y_mm, motion->heading_rad).cwiseAbs2();
      ++out.still_matches;
    }
  }

  /// Leaves out one stretch after the other.
  [[nodiscard]] Vector6 jackknife(const std::vector<WheelSample>& samples) const {
    constexpr std::size_t blocks = 12;
    std::vector<Vector6> results;
    for (std::size_t block = 0; block < blocks; ++block) {
      std::vector<WheelSample> rest;
      for (std::size_t k = 0; k < samples.size(); ++k)
        if (k * blocks / samples.size() != block) rest.push_back(samples[k]);
      if (rest.size() < 20) return Vector6::Zero();
      results.push_back(fit_odometry(rest, options_.fit).robot.vector());
    }
    Vector6 mean = Vector6::Zero(), squares = Vector6::Zero();
    for (const Vector6& v : results) mean += v / blocks;
    for (const Vector6& v : results) {
      Vector6 d = v - mean;
      d[5] = wrap_angle(d[5]);
      squares += d.cwiseAbs2();
    }
    return (squares * (blocks - 1.0) / blocks).cwiseSqrt();
  }

  void widen(DriveFit& out) const {
    out.jackknife_u = jackknife(out.samples);
    const Vector6 u = out.odometry.covariance.diagonal().cwiseSqrt();
    const Vector6 factor = out.jackknife_u.cwiseQuotient(u).cwiseMax(1);
    out.odometry.covariance = factor.asDiagonal() * out.odometry.covariance * factor.asDiagonal();
  }

  DriveOptions options_;
  Wheels wheels_;
  std::vector<Sweep> sweeps_;
  Pose2 lidar_;
  Path path_;
  SweepTiming timing_;
  std::vector<Still> stills_;
};

}  // namespace

Path path_from_wheels(const std::vector<TrackPose>& track, const RobotGeometry& robot) {
  std::vector<TimedPose> poses;
  Pose2 at;
  std::optional<TrackPose> last;
  for (const TrackPose& now : track) {
    if (!now.wheel_left_rad || !now.wheel_right_rad) continue;
    if (last && now.host_us > last->host_us) {
      WheelSample sample;
      sample.interval_s = 1;
      sample.left_rad_s = *now.wheel_left_rad - *last->wheel_left_rad;
      sample.right_rad_s = *now.wheel_right_rad - *last->wheel_right_rad;
      at = at * wheel_motion(robot, sample);
    }
    poses.push_back({static_cast<double>(now.host_us) * 1e-6, at});
    last = now;
  }
  return Path(std::move(poses));
}

DriveFit fit_drive(const Recording& recording, const DriveOptions& options) {
  return Drive(recording, options).run(recording);
}

}  // namespace fit
