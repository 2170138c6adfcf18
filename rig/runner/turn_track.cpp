// SPDX-License-Identifier: MIT
#include "rig/runner/turn_track.hpp"

#include <algorithm>
#include <cmath>

#include "fit/numeric/number_format.hpp"

namespace rig {
namespace {

// Beyond question and answer: a controller's own cycle, a USB adapter that collects bytes, a busy computer.
constexpr double answer_delay_s = 0.02;
constexpr double smallest_half_s = 0.002;
// Worm gears and microsteps: no stage here turns more smoothly.
constexpr double unevenness_deg = 0.05;
// Controllers have their speeds in whole device units, or steps of a prescaler.
constexpr double rate_share = 0.03;

std::string deg(double value) { return fit::format_value(value, 2) + " deg"; }

}  // namespace

void TurnTrack::add(double s, double deg, double half_s) { poses_.push_back({s, deg, half_s}); }

TurnTrack::Line TurnTrack::line_at(double s) const {
  const auto weight = [](const Pose& pose) {
    const double half_s = std::max(pose.half_s, smallest_half_s);
    return 1 / (half_s * half_s);
  };
  double sum = 0, mean_s = 0, mean_deg = 0;
  for (const Pose& pose : poses_) {
    sum += weight(pose);
    mean_s += weight(pose) * pose.s;
    mean_deg += weight(pose) * pose.deg;
  }
  if (poses_.empty()) return {};
  mean_s /= sum, mean_deg /= sum;
  double along = 0, across = 0;
  for (const Pose& pose : poses_) {
    along += weight(pose) * (pose.s - mean_s) * (pose.s - mean_s);
    across += weight(pose) * (pose.s - mean_s) * (pose.deg - mean_deg);
  }
  const double rate_deg_s = along > 0 ? across / along : 0;
  return {mean_deg + rate_deg_s * (s - mean_s), rate_deg_s};
}

std::string TurnTrack::disturbance(double commanded_deg_s, double resolution_deg) const {
  if (poses_.size() < 2) return "";
  const double speed = std::abs(commanded_deg_s), base_deg = unevenness_deg + 2 * resolution_deg;
  const double first_s = poses_.front().s;
  const Line line = line_at(first_s);
  double off_deg = 0, beyond = 0, widest_deg = 0;
  for (const Pose& pose : poses_) {
    const double away_deg = std::abs(pose.deg - line.at_deg - line.rate_deg_s * (pose.s - first_s));
    const double allowed_deg = base_deg + speed * (pose.half_s + answer_delay_s);
    // A single late answer says little of the rate.
    widest_deg = std::max(widest_deg, base_deg + speed * (std::min(pose.half_s, 0.1) + answer_delay_s));
    if (away_deg / allowed_deg > beyond) beyond = away_deg / allowed_deg, off_deg = away_deg;
  }
  if (beyond > 1)
    return "the stage did not turn evenly: its positions are up to " + deg(off_deg) + " off a straight line";
  const double lasted_s = poses_.back().s - first_s;
  const double allowed_deg_s = rate_share * speed + 2 * widest_deg / std::max(lasted_s, 1e-6);
  if (std::abs(line.rate_deg_s - commanded_deg_s) > allowed_deg_s)
    return "the stage turned at " + fit::format_value(line.rate_deg_s, 2) + " deg/s instead of " +
           fit::format_value(commanded_deg_s, 2) + " deg/s";
  return "";
}

}  // namespace rig
