// SPDX-License-Identifier: MIT
#include "fit/motion/wheel_time.hpp"

#include <algorithm>
#include <cmath>

namespace fit {

std::vector<Eigen::Vector2d> pieces_of(const WheelSample& sample) {
  if (!sample.pieces.empty()) return sample.pieces;
  return {Eigen::Vector2d(sample.left_rad_s, sample.right_rad_s) * sample.interval_s};
}

void WheelTime::add(double begin_s, double end_s, const Eigen::Vector2d& piece) {
  if (end_s > begin_s) known_.push_back({begin_s, end_s, piece});
}

bool WheelTime::covers(double from_s, double to_s) const {
  return !known_.empty() && from_s >= begin_s() - 1e-9 && to_s <= end_s() + 1e-9;
}

std::vector<Eigen::Vector2d> WheelTime::pieces(double from_s, double to_s, const Steering& steering) const {
  std::vector<Eigen::Vector2d> out;
  auto it = std::ranges::upper_bound(known_, from_s, {}, &At::end_s);
  for (; it != known_.end() && it->begin_s < to_s; ++it) {
    const double from = std::max(from_s, it->begin_s), to = std::min(to_s, it->end_s);
    if (to > from) out.push_back(steering.part_of(it->piece, (to - from) / (it->end_s - it->begin_s)));
  }
  if (out.empty()) out.emplace_back(Eigen::Vector2d::Zero());
  return out;
}

TimedSamples::TimedSamples(std::vector<WheelSample> samples, bool timed, const Steering& steering)
    : samples_(std::move(samples)), steering_(&steering) {
  std::size_t runs = 0;
  for (const WheelSample& sample : samples_) runs = std::max(runs, sample.run + 1);
  runs_.resize(runs);
  for (WheelSample& sample : samples_) {
    WheelTime& wheels = runs_[sample.run];
    if (!timed) sample.begin_s = wheels.end_s();
    const auto pieces = pieces_of(sample);
    const double each = sample.interval_s / static_cast<double>(pieces.size());
    for (std::size_t i = 0; i < pieces.size(); ++i)
      wheels.add(sample.begin_s + static_cast<double>(i) * each,
                 sample.begin_s + static_cast<double>(i + 1) * each, pieces[i]);
  }
}

TimedSamples::TimedSamples(std::vector<WheelSample> samples, WheelTime wheels, const Steering& steering)
    : samples_(std::move(samples)), runs_{std::move(wheels)}, steering_(&steering) {}

bool TimedSamples::covers(std::size_t index, double by_s) const {
  const WheelSample& sample = samples_[index];
  const double from = sample.begin_s + by_s;
  return wheels_of(sample).covers(from, from + sample.interval_s);
}

WheelSample TimedSamples::shifted(std::size_t index, double by_s) const {
  WheelSample out = samples_[index];
  const double from = out.begin_s + by_s;
  out.pieces = wheels_of(out).pieces(from, from + out.interval_s, *steering_);
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& piece : out.pieces) sum += piece;
  out.left_rad_s = sum.x() / out.interval_s;
  out.right_rad_s = sum.y() / out.interval_s;
  return out;
}

std::vector<WheelSample> TimedSamples::shifted(double by_s) const {
  std::vector<WheelSample> out;
  for (std::size_t i = 0; i < samples_.size(); ++i)
    if (covers(i, by_s)) out.push_back(shifted(i, by_s));
  return out;
}

double TimedSamples::shortest_run_s() const {
  double shortest = 1e300;
  for (const WheelTime& run : runs_)
    if (run.end_s() > run.begin_s()) shortest = std::min(shortest, run.end_s() - run.begin_s());
  return shortest;
}

bool follows(const WheelSample& before, const WheelSample& next) {
  return next.run == before.run && std::abs(next.begin_s - before.begin_s - before.interval_s) <
                                       0.25 * std::min(before.interval_s, next.interval_s);
}

}  // namespace fit
