// SPDX-License-Identifier: MIT
#include "fit/motion/wheel_track.hpp"

#include <algorithm>

#include "fit/numeric/median.hpp"

namespace fit {
namespace {

using Eigen::Vector2d;

}  // namespace

std::vector<double> even_times(const std::vector<double>& stamps) {
  constexpr std::size_t half = 100, least = 20;
  std::vector<double> steps;
  for (std::size_t i = 1; i < stamps.size(); ++i) steps.push_back(stamps[i] - stamps[i - 1]);
  const double usual = median_of(std::vector<double>(steps));
  std::vector<double> out = stamps;
  for (std::size_t begin = 0; begin < stamps.size();) {
    std::size_t end = begin + 1;
    while (end < stamps.size() && steps[end - 1] < 3.5 * usual) ++end;
    for (std::size_t i = begin; end - begin >= least && i < end; ++i) {
      const std::size_t from = i > begin + half ? i - half : begin, to = std::min(end, i + half + 1);
      double n = 0, x = 0, y = 0, xx = 0, xy = 0;
      for (std::size_t k = from; k < to; ++k) {
        const double at = static_cast<double>(k) - static_cast<double>(i), stamp = stamps[k] - stamps[i];
        n += 1, x += at, y += stamp, xx += at * at, xy += at * stamp;
      }
      const double slope = (n * xy - x * y) / (n * xx - x * x);
      out[i] = stamps[i] + (y - slope * x) / n;
    }
    begin = end;
  }
  for (std::size_t i = 1; i < out.size(); ++i) out[i] = std::max(out[i], out[i - 1] + 1e-6);
  return out;
}

WheelTrack::WheelTrack(const std::vector<TrackPose>& track) {
  for (const TrackPose& pose : track)
    if (pose.wheel_left_rad && pose.wheel_right_rad)
      known_.push_back(
          {static_cast<double>(pose.host_us) * 1e-6, {*pose.wheel_left_rad, *pose.wheel_right_rad}});
  std::ranges::stable_sort(known_, {}, &At::time_s);
  const auto same_time = [](const At& a, const At& b) { return a.time_s == b.time_s; };
  known_.erase(std::unique(known_.begin(), known_.end(), same_time), known_.end());
}

void WheelTrack::make_times_even() {
  std::vector<double> times;
  for (const At& at : known_) times.push_back(at.time_s);
  times = even_times(times);
  for (std::size_t i = 0; i < known_.size(); ++i) known_[i].time_s = times[i];
}

bool WheelTrack::covers(double from, double to) const {
  return size() >= 2 && from >= known_.front().time_s && to <= known_.back().time_s;
}

Vector2d WheelTrack::at(double time_s) const {
  const auto b = after(time_s), a = b - 1;
  return a->angle + (time_s - a->time_s) / (b->time_s - a->time_s) * (b->angle - a->angle);
}

std::vector<Vector2d> WheelTrack::pieces(double from, double to) const {
  std::vector<Vector2d> out;
  Vector2d last = at(from);
  for (auto it = after(from); it != known_.end() && it->time_s < to; ++it) {
    out.push_back(it->angle - last);
    last = it->angle;
  }
  out.push_back(at(to) - last);
  return out;
}

WheelSample WheelTrack::sample_between(double from, double to) const {
  WheelSample sample;
  sample.begin_s = from;
  sample.interval_s = to - from;
  sample.pieces = pieces(from, to);
  const Vector2d turned = at(to) - at(from);
  sample.left_rad_s = turned.x() / sample.interval_s;
  sample.right_rad_s = turned.y() / sample.interval_s;
  return sample;
}

Path WheelTrack::path(const RobotGeometry& robot) const {
  std::vector<TimedPose> poses;
  Pose2 at;
  for (std::size_t i = 0; i < known_.size(); ++i) {
    WheelSample sample;
    if (i > 0) sample.pieces = {known_[i].angle - known_[i - 1].angle};
    at = at * wheel_motion(robot, sample);
    poses.push_back({known_[i].time_s, at});
  }
  return Path(std::move(poses));
}

WheelTime WheelTrack::over_time() const {
  WheelTime out;
  for (std::size_t i = 1; i < known_.size(); ++i)
    out.add(known_[i - 1].time_s, known_[i].time_s, known_[i].angle - known_[i - 1].angle);
  return out;
}

std::vector<WheelTrack::At>::const_iterator WheelTrack::after(double time_s) const {
  return std::upper_bound(known_.begin() + 1, known_.end() - 1, time_s,
                          [](double t, const At& at) { return t < at.time_s; });
}

}  // namespace fit
