// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <vector>

#include "fit/motion/odometry.hpp"

namespace fit {

/// What the wheels did over the time of one run, so that it can be cut anew at other times.
class WheelTime {
 public:
  /// Pieces follow each other; a gap counts as standing.
  void add(double begin_s, double end_s, const Eigen::Vector2d& piece);
  [[nodiscard]] bool covers(double from_s, double to_s) const;
  /// The pieces from one time to another. Precondition: covered.
  [[nodiscard]] std::vector<Eigen::Vector2d> pieces(double from_s, double to_s,
                                                    const Steering& steering) const;
  [[nodiscard]] double begin_s() const { return known_.empty() ? 0 : known_.front().begin_s; }
  [[nodiscard]] double end_s() const { return known_.empty() ? 0 : known_.back().end_s; }

 private:
  struct At {
    double begin_s, end_s;
    Eigen::Vector2d piece;
  };
  std::vector<At> known_;
};

/// Samples of some runs, in order of time, with the wheels of each run.
class TimedSamples {
 public:
  /// Samples of a run follow each other in their order; `begin_s` are measured times, or, where `timed` is
  /// false, every sample is taken to begin when the one before ended.
  TimedSamples(std::vector<WheelSample> samples, bool timed, const Steering& steering);
  /// Samples of one drive whose wheels are known by themselves.
  TimedSamples(std::vector<WheelSample> samples, WheelTime wheels, const Steering& steering);
  [[nodiscard]] const std::vector<WheelSample>& samples() const { return samples_; }
  /// The same matches with what the wheels did `by_s` later; without those that the wheels do not cover.
  [[nodiscard]] std::vector<WheelSample> shifted(double by_s) const;
  /// The sample at `index` shifted; its wheels must cover it.
  [[nodiscard]] WheelSample shifted(std::size_t index, double by_s) const;
  [[nodiscard]] bool covers(std::size_t index, double by_s) const;
  [[nodiscard]] double shortest_run_s() const;

 private:
  [[nodiscard]] const WheelTime& wheels_of(const WheelSample& sample) const {
    return runs_.size() == 1 ? runs_.front() : runs_[sample.run];
  }
  std::vector<WheelSample> samples_;
  std::vector<WheelTime> runs_;
  const Steering* steering_;
};

/// What the wheels did in a sample, piece by piece.
[[nodiscard]] std::vector<Eigen::Vector2d> pieces_of(const WheelSample& sample);

/// Whether a sample of the same run begins where the one before it ends.
[[nodiscard]] bool follows(const WheelSample& before, const WheelSample& next);

}  // namespace fit
