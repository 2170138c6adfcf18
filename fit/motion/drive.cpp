// SPDX-License-Identifier: MIT
#include "fit/motion/drive.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

#include "fit/motion/drive_lengths.hpp"
#include "fit/motion/icp.hpp"
#include "fit/motion/wheel_track.hpp"
#include "fit/numeric/median.hpp"

namespace fit {
namespace {

using Eigen::Vector2d;

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
      path_ = wheels_.path(options.guess);
    } else {
      throw std::invalid_argument(
          "The session holds no odometry to start from. Give the nominal wheels with the options "
          "wheel_radius_mm "
          "and separation_mm");
    }
  }

  DriveFit run() {
    DriveFit out;
    out.own_beams = leave_out_own_beams();
    timing_.offset_s = options_.known_offset_s.value_or(0);
    compare_clocks(out);
    if (!options_.known_offset_s && out.coarse.determined) timing_.offset_s = out.coarse.offset_s.value;
    for (int round = 0; round < options_.rounds; ++round) {
      deskew_all();
      collect(out, 1);
      if (out.samples.size() < 20)
        throw std::invalid_argument(
            "Only " + std::to_string(out.samples.size()) +
            " pairs of scans could be matched while the robot moved (" + std::to_string(out.bad_matches) +
            " were left out as doubtful): at least 20 are needed, and some hundreds for a "
            "good result. Drive longer, within sight of walls");
      out.odometry = fit_odometry(out.samples, options_.fit);
      if (!options_.known_offset_s) refine_offset(out);
      out.rounds.push_back(out.odometry.robot);
      if (usable(out.odometry)) {
        lidar_ = out.odometry.robot.lidar;
        path_ = wheels_.path(out.odometry.robot);
      }
      if (round == 0) decide_order(out);
      if (!usable(out.odometry)) break;
    }
    if (usable(out.odometry)) {
      match_at_lengths(out);
    } else {
      mark_segments(out.samples);
      out.segments = find_slipped(out.samples, out.odometry.robot);
      out.jackknife_u =
          jackknife(without_each_segment(out.samples, out.segments, out.odometry)).diagonal().cwiseSqrt();
      widen_to(out.odometry.covariance, out.jackknife_u);
    }
    return out;
  }

 private:
  [[nodiscard]] static bool usable(const OdometryFit& fit) {
    return fit.robot.separation_mm > 0 && fit.robot.left_radius_mm > 0 && fit.robot.right_radius_mm > 0 &&
           fit.undetermined.empty();
  }

  /// Beams whose ranges hardly change while the robot drives see the robot itself: the middle nine tenths of
  /// their echoes spread less than a tenth of what those of the median beam do.
  std::size_t leave_out_own_beams() {
    std::vector<std::vector<double>> ranges;
    for (const Sweep& sweep : sweeps_)
      for (const SweptPoint& point : sweep.points) {
        if (point.beam >= ranges.size()) ranges.resize(point.beam + 1);
        ranges[point.beam].push_back(point.at_mm.norm());
      }
    std::vector<double> spread(ranges.size(), -1), known;
    for (std::size_t beam = 0; beam < ranges.size(); ++beam) {
      auto& some = ranges[beam];
      if (some.size() < 3) continue;
      std::ranges::sort(some);
      spread[beam] = some[(some.size() - 1) * 95 / 100] - some[some.size() * 5 / 100];
      known.push_back(spread[beam]);
    }
    const double limit = 0.1 * median_of(known);
    std::size_t count = 0;
    for (const double value : spread) count += value >= 0 && value < limit;
    for (Sweep& sweep : sweeps_)
      std::erase_if(sweep.points, [&](const SweptPoint& p) { return spread[p.beam] < limit; });
    return count;
  }

  /// Motions from scans as they came, each matched to the next from where the last motion would bring it:
  /// nothing of this depends on the wheels or on their time.
  [[nodiscard]] std::vector<std::optional<Pose2>> consecutive_motions() const {
    std::vector<std::optional<Pose2>> out;
    Pose2 last;
    Still before;
    for (std::size_t i = 0; i < sweeps_.size(); ++i) {
      Still now;
      for (const SweptPoint& point : sweeps_[i].points) now.points.push_back(point.at_mm);
      now.cloud = PointCloud(orient_sweep(now.points));
      const double step_s = i > 0 ? sweeps_[i].begin_s - sweeps_[i - 1].begin_s : 0;
      if (i > 0) out.push_back(step_s < 0.5 * options_.longest_s ? match(before, now, last) : std::nullopt);
      last = i > 0 ? out.back().value_or(Pose2{}) : Pose2{};
      before = std::move(now);
    }
    return out;
  }

  [[nodiscard]] OffsetSearch offset_of(const std::vector<std::optional<Pose2>>& motions,
                                       const std::vector<double>& times, const WheelTrack& wheels) const {
    std::vector<WheelSample> samples;
    for (std::size_t i = 0; i < motions.size(); ++i) {
      if (!motions[i] || !(times[i + 1] > times[i])) continue;
      WheelSample sample;
      sample.begin_s = times[i] + 0.5 * sweeps_[i].duration_s;
      sample.interval_s = times[i + 1] - times[i];
      sample.match = *motions[i];
      samples.push_back(std::move(sample));
    }
    return find_offset(TimedSamples(std::move(samples), wheels.over_time(), differential()), options_.fit,
                       options_.offset);
  }

  /// The coarse offset; and whether stamps made even are the better ones: those of scans, or of scans and
  /// wheels, if wheels and matches then agree better by more than a tenth.
  void compare_clocks(DriveFit& out) {
    const auto motions = consecutive_motions();
    std::vector<double> stamps;
    for (const Sweep& sweep : sweeps_) stamps.push_back(sweep.begin_s);
    const auto even = even_times(stamps);
    double squares = 0;
    for (std::size_t i = 0; i < stamps.size(); ++i) squares += (even[i] - stamps[i]) * (even[i] - stamps[i]);
    out.scan_jitter_s = std::sqrt(squares / static_cast<double>(stamps.size()));
    out.coarse = offset_of(motions, stamps, wheels_);
    // As good as even already.
    if (out.scan_jitter_s < 0.01 * sweeps_.front().duration_s) return;
    WheelTrack even_wheels = wheels_;
    even_wheels.make_times_even();
    const WheelTrack as_stamped = wheels_;
    for (const bool both : {false, true}) {
      const OffsetSearch other = offset_of(motions, even, both ? even_wheels : as_stamped);
      if (!other.determined || !(other.misfit < 0.9 * out.coarse.misfit)) continue;
      out.coarse = other;
      out.even_scans = true, out.even_wheels = both;
      if (both) wheels_ = even_wheels;
      for (std::size_t i = 0; i < sweeps_.size(); ++i) sweeps_[i].begin_s = even[i];
    }
  }

  /// Shifts the wheels' time to where wheels and matches agree best; they are much the better clock than the
  /// agreement of scans. The samples are made anew there.
  void refine_offset(DriveFit& out) {
    OffsetOptions near = options_.offset;
    // What the coarse search has found is not left again for another place.
    near.first_s = near.widest_s = out.coarse.determined ? 0.3 : near.first_s;
    const TimedSamples timed(out.samples, wheels_.over_time(), differential());
    OffsetSearch found = find_offset(timed, options_.fit, near);
    if (found.determined) {
      const double move = found.offset_s.value;
      const auto shifted = timed.shifted(move);
      if (shifted.size() >= 20) {
        out.samples = shifted;
        for (WheelSample& sample : out.samples) sample.begin_s += move;
        timing_.offset_s += move;
        out.odometry = fit_odometry(out.samples, options_.fit);
      }
    }
    found.offset_s.value = timing_.offset_s;
    out.offset = found;
    if (out.coarse.at_bound) out.offset.at_bound = true, out.offset.determined = false;
    out.offset.searched_s = std::max(out.coarse.searched_s, found.searched_s);
  }

  /// Whether the beams are listed against their order in time, by the agreement of scans, each order at its
  /// own best offset about that of the wheels.
  void decide_order(DriveFit& out) {
    TimingOptions about;
    about.about_s = timing_.offset_s;
    about.steps = 10;
    out.timing = estimate_timing(sweeps_, path_, lidar_, about);
    timing_.reversed = out.timing.timing.reversed;
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

  /// Where the path puts the lidar at the second scan, seen from the first.
  [[nodiscard]] Pose2 guess_between(const Still& a, const Still& b) const {
    return (path_.at(a.time_s) * lidar_).inverse() * (path_.at(b.time_s) * lidar_);
  }

  /// Motion of the lidar from one scan to another, from matching both onto each other.
  [[nodiscard]] static std::optional<Pose2> match(const Still& a, const Still& b, const Pose2& guess) {
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

  [[nodiscard]] bool far_enough(double from, double to, double multiple) const {
    const Pose2 motion = path_.at(from).inverse() * path_.at(to);
    return motion.position().norm() >= multiple * options_.least_way_mm ||
           std::abs(motion.heading_rad) >= multiple * options_.least_turn_rad;
  }

  /// From every scan to the first one far enough away.
  void collect(DriveFit& out, double multiple) {
    const double longest_s = multiple * options_.longest_s;
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
      while (j + 1 < stills_.size() && stills_[j].time_s - from < longest_s &&
             !far_enough(from, stills_[j].time_s, multiple))
        ++j;
      const double to = stills_[j].time_s;
      if (!wheels_.covers(from, to) || to - from > 1.5 * longest_s) continue;
      const auto motion = match(stills_[i], stills_[j], guess_between(stills_[i], stills_[j]));
      if (!motion) {
        ++out.bad_matches;
        continue;
      }
      WheelSample sample = wheels_.sample_between(from, to);
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
    if (const auto motion = match(stills_[i], stills_[j], guess_between(stills_[i], stills_[j]))) {
      out.still_noise += Eigen::Vector3d(motion->x_mm, motion->y_mm, motion->heading_rad).cwiseAbs2();
      ++out.still_matches;
    }
  }

  /// Which of twelve segments of the drive each sample begins in: as many samples in each at the first
  /// length, the same times at every other.
  void mark_segments(std::vector<WheelSample>& samples) {
    constexpr std::size_t segments = 12;
    if (segment_ends_s_.empty())
      for (std::size_t k = 1; k < segments; ++k)
        segment_ends_s_.push_back(samples[k * samples.size() / segments].begin_s);
    for (WheelSample& sample : samples)
      sample.run = static_cast<std::size_t>(std::ranges::upper_bound(segment_ends_s_, sample.begin_s) -
                                            segment_ends_s_.begin());
  }

  /// The values without each segment that was not left out; where it has no samples, or no others have, with
  /// all.
  [[nodiscard]] std::vector<Vector6> without_each_segment(const std::vector<WheelSample>& samples,
                                                          const std::vector<RunVerdict>& segments,
                                                          const OdometryFit& all) const {
    std::vector<Vector6> out;
    for (const RunVerdict& segment : segments) {
      if (segment.left_out) continue;
      std::vector<WheelSample> rest;
      for (const WheelSample& sample : samples)
        if (sample.run != segment.run) rest.push_back(sample);
      const bool as_all = rest.size() == samples.size() || rest.size() < 20;
      out.push_back(as_all ? all.robot.vector() : fit_odometry(rest, options_.fit).robot.vector());
    }
    return out;
  }

  /// Matches scans at every length and leaves out segments with slip.
  void match_at_lengths(DriveFit& out) {
    DriveFit at = out;
    std::vector<std::vector<WheelSample>> samples;
    std::vector<OdometryFit> fits;
    for (const double multiple : options_.lengths) {
      if (multiple != 1) collect(at, multiple);
      mark_segments(at.samples);
      if (at.samples.size() < 60) break;
      if (samples.empty())
        out.segments = find_slipped(at.samples, fit_odometry(at.samples, options_.fit).robot);
      std::erase_if(at.samples, [&](const WheelSample& sample) {
        return std::ranges::any_of(out.segments, [&](const RunVerdict& segment) {
          return segment.left_out && segment.run == sample.run;
        });
      });
      DriveLength length;
      length.multiple = multiple;
      length.samples = at.samples.size();
      std::vector<double> ways, times;
      for (const WheelSample& sample : at.samples)
        ways.push_back(sample.match.position().norm()), times.push_back(sample.interval_s);
      length.way_mm = median_of(ways), length.interval_s = median_of(times);
      fits.push_back(fit_odometry(at.samples, options_.fit));
      length.values = fits.back().robot.vector();
      length.without = without_each_segment(at.samples, out.segments, fits.back());
      length.u = jackknife(length.without).diagonal().cwiseSqrt();
      out.lengths.push_back(length);
      samples.push_back(std::move(at.samples));
    }
    if (out.lengths.empty()) return;
    choose_length(out, samples, fits, options_.range_scale);
  }

  DriveOptions options_;
  WheelTrack wheels_;
  std::vector<Sweep> sweeps_;
  Pose2 lidar_;
  Path path_;
  SweepTiming timing_;
  std::vector<Still> stills_;
  std::vector<double> segment_ends_s_;
};

}  // namespace

Path path_from_wheels(const std::vector<TrackPose>& track, const RobotGeometry& robot) {
  return WheelTrack(track).path(robot);
}

DriveFit fit_drive(const Recording& recording, const DriveOptions& options) {
  return Drive(recording, options).run();
}

}  // namespace fit
