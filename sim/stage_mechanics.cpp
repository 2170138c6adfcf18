// SPDX-License-Identifier: MIT
#include "sim/stage_mechanics.hpp"

#include <algorithm>
#include <cmath>

namespace sim {

namespace {

constexpr double past_kept_s =
    10;  ///< The engine asks for moments of a scan that began before the last command.
constexpr double deg = fit::rad_per_deg;

double sign(double x) { return x > 0 ? 1 : x < 0 ? -1 : 0; }

}  // namespace

double StageMechanics::Segment::motor_at(double time_s) const {
  const double t = time_s - start_s;
  return motor + rate * t + acceleration * t * t / 2;
}

StageMechanics::StageMechanics(const StagePhysics& physics)
    : physics_(physics),
      speed_(physics.speed_deg_s * physics.units_per_deg),
      acceleration_(physics.acceleration_deg_s2 * physics.units_per_deg) {
  const double motor = std::round(physics.power_on_deg * physics.units_per_deg);
  offset_ = offset_before_home_ = motor;
  segments_.push_back({-1e9, motor, 0, 0, motor});
}

std::size_t StageMechanics::segment_at(double time_s) const {
  std::size_t i = segments_.size() - 1;
  while (i > 0 && segments_[i].start_s > time_s) --i;
  return i;
}

double StageMechanics::counter_offset(double time_s) const {
  return time_s >= homed_from_s_ ? offset_ : offset_before_home_;
}

double StageMechanics::position_units(double time_s) const {
  return segments_[segment_at(time_s)].motor_at(time_s) - counter_offset(time_s);
}

double StageMechanics::rate_units_s(double time_s) const {
  return segments_[segment_at(time_s)].rate_at(time_s);
}

bool StageMechanics::moving(double time_s) const {
  const Segment& now = segments_[segment_at(time_s)];
  return now.rate != 0 || now.acceleration != 0;
}

double StageMechanics::min_units(double time_s) const {
  return physics_.min_deg * physics_.units_per_deg - counter_offset(time_s);
}

double StageMechanics::max_units(double time_s) const {
  return physics_.max_deg * physics_.units_per_deg - counter_offset(time_s);
}

double StageMechanics::settle_s() const {
  constexpr double to_one_percent = 4.6;
  double settle = 0;
  if (physics_.spring_hz > 0)
    settle = to_one_percent / (physics_.spring_damping * 2 * fit::pi * physics_.spring_hz);
  if (physics_.creep_deg != 0) settle = std::max(settle, to_one_percent * physics_.creep_s);
  return settle;
}

double StageMechanics::rest_s() const {
  const Segment& last = segments_.back();
  if (last.rate != 0 || last.acceleration != 0) return -never_s;
  return last.start_s + settle_s();
}

// --- planning ---

void StageMechanics::cut(double now_s) {
  const std::size_t i = segment_at(now_s);
  segments_.erase(segments_.begin() + static_cast<std::ptrdiff_t>(i) + 1, segments_.end());
  if (homed_from_s_ > now_s) homed_from_s_ = never_s;  // Homing was interrupted.
}

void StageMechanics::forget_before(double time_s) {
  while (segments_.size() > 2 && segments_[1].start_s < time_s) segments_.pop_front();
}

void StageMechanics::append(double start_s, double rate, double acceleration) {
  const Segment& last = segments_.back();
  start_s = std::max(start_s, last.start_s);
  segments_.push_back({start_s, last.motor_at(start_s), rate, acceleration, table_at(last, start_s)});
}

void StageMechanics::plan_rate(double now_s, double rate) {
  cut(now_s);
  forget_before(now_s - past_kept_s);
  double v = segments_.back().rate_at(now_s);
  double t = now_s;
  if (v * rate < 0) {  // Through standstill, so that a segment never reverses.
    append(t, v, -sign(v) * acceleration_);
    t += std::abs(v) / acceleration_;
    v = 0;
  }
  if (v != rate) {
    append(t, v, sign(rate - v) * acceleration_);
    t += std::abs(rate - v) / acceleration_;
  }
  append(t, rate, 0);
}

void StageMechanics::plan_to(double now_s, double target, double speed) {
  cut(now_s);
  double t = now_s;
  double v = segments_.back().rate_at(t);
  double p = segments_.back().motor_at(t);
  const double a = acceleration_;
  const double braking = v * std::abs(v) / (2 * a);
  if (v != 0 && (target - p) * v < 0) {
    append(t, v, -sign(v) * a);
    t += std::abs(v) / a;
    p += braking;
    v = 0;
  } else if (v != 0 &&
             std::abs(target - p) < std::abs(braking)) {  // Cannot stop in time: overshoots, comes back.
    append(t, v, -sign(v) * a);
    t += std::abs(v) / a;
    p += braking;
    v = 0;
  }
  const double distance = target - p;
  if (distance == 0 && v == 0) {
    if (segments_.back().acceleration != 0 || segments_.back().rate != 0) append(t, 0, 0);
    return;
  }
  const double way = sign(distance);
  const double v0 = std::abs(v);
  // Peak speed of the shortest move: v0 up (or down to `speed`), then down to rest.
  const double peak = std::min(speed, std::sqrt(std::max(0.0, a * std::abs(distance) + v0 * v0 / 2)));
  const double ramp_s = std::abs(peak - v0) / a;
  const double ramp = (peak + v0) / 2 * ramp_s;
  const double cruise = std::max(0.0, std::abs(distance) - ramp - peak * peak / (2 * a));
  if (ramp_s > 0) append(t, way * v0, way * sign(peak - v0) * a);
  t += ramp_s;
  if (cruise > 0) append(t, way * peak, 0);
  t += cruise / peak;
  append(t, way * peak, -way * a);
  t += peak / a;
  append(t, 0, 0);
  // Floating point: the motor stands on the whole unit it was sent to.
  segments_.back().motor = target;
}

void StageMechanics::move_to(double now_s, double target_units) {
  forget_before(now_s - past_kept_s);
  plan_to(now_s, std::round(target_units) + counter_offset(now_s), speed_);
}

void StageMechanics::turn(double now_s, double units_per_s) { plan_rate(now_s, units_per_s); }

void StageMechanics::stop(double now_s) {
  if (!moving(now_s)) return cut(now_s);
  plan_rate(now_s, 0);
  // A motor stands on whole units only.
  segments_.back().motor = std::round(segments_.back().motor);
}

void StageMechanics::halt(double now_s) {
  cut(now_s);
  forget_before(now_s - past_kept_s);
  append(now_s, 0, 0);
  segments_.back().motor = std::round(segments_.back().motor);
}

void StageMechanics::home(double now_s, double overrun_units) {
  const double offset = counter_offset(now_s);
  const double speed = physics_.homing_speed_deg_s * physics_.units_per_deg;
  forget_before(now_s - past_kept_s);
  plan_to(now_s, -overrun_units, speed);
  if (overrun_units != 0) plan_to(std::max(now_s, segments_.back().start_s), 0, speed);
  offset_before_home_ = offset;
  offset_ = 0;
  homed_from_s_ = std::max(now_s, segments_.back().start_s);
}

void StageMechanics::count_from(double now_s, double units) {
  offset_before_home_ = offset_ = segments_[segment_at(now_s)].motor_at(now_s) - units;
}

void StageMechanics::slip(double now_s, double full_steps) {
  const double units = full_steps * physics_.full_step_deg * physics_.units_per_deg;
  cut(now_s);
  const Segment last = segments_.back();
  append(now_s, last.rate_at(now_s), last.acceleration);
  segments_.back().motor += units;
  segments_.back().table += units;
  offset_ += units;
  offset_before_home_ += units;
}

void StageMechanics::power_cycle(double now_s) {
  halt(now_s);
  homed_from_s_ = never_s;
  count_from(now_s, 0);
  speed_ = physics_.speed_deg_s * physics_.units_per_deg;
  acceleration_ = physics_.acceleration_deg_s2 * physics_.units_per_deg;
}

// --- where the table is ---

/// The play operator: the table follows only when the motor has taken up the play. Exact, because a segment
/// never reverses.
double StageMechanics::table_at(const Segment& segment, double time_s) const {
  const double motor = segment.motor_at(time_s);
  const double half_play = physics_.backlash_deg * physics_.units_per_deg / 2;
  return std::clamp(segment.table, motor - half_play, motor + half_play);
}

/// The rotor hangs on its magnetic spring: under acceleration a it lags by a / w^2, and rings about the new
/// balance when the acceleration changes. Creep lags behind the way of the last motion.
double StageMechanics::settling_deg(std::size_t index, double time_s) const {
  const Segment& segment = segments_[index];
  const double before = index > 0 ? segments_[index - 1].acceleration : 0;
  const double since_s = time_s - segment.start_s;
  double offset = 0;
  if (physics_.spring_hz > 0) {
    const double w = 2 * fit::pi * physics_.spring_hz;
    const double decay = std::exp(-physics_.spring_damping * w * since_s);
    const double ring = (segment.acceleration - before) * decay * std::cos(w * since_s);
    offset += (ring - segment.acceleration) / (w * w * physics_.units_per_deg);
  }
  if (physics_.creep_deg != 0 && index > 0 && segment.rate == 0 && segment.acceleration == 0) {
    const double way = sign(segments_[index - 1].rate);
    offset -= way * physics_.creep_deg * std::exp(-since_s / physics_.creep_s);
  }
  return offset;
}

StageMoment StageMechanics::truth(double time_s) const {
  const std::size_t index = segment_at(time_s);
  const Segment& segment = segments_[index];
  const double motor_deg = segment.motor_at(time_s) / physics_.units_per_deg;
  const double table_units = table_at(segment, time_s);
  double angle_deg = table_units / physics_.units_per_deg;
  const double wheel_deg = angle_deg;
  angle_deg += physics_.scale * wheel_deg;
  if (physics_.wheel_deg != 0)
    angle_deg += physics_.wheel_deg * std::sin((wheel_deg + physics_.wheel_phase_deg) * deg);
  if (physics_.worm_deg != 0)
    angle_deg +=
        physics_.worm_deg * std::sin((physics_.worm_teeth * motor_deg + physics_.worm_phase_deg) * deg);
  if (physics_.motor_deg != 0)
    angle_deg += physics_.motor_deg * std::sin(2 * fit::pi * motor_deg / (4 * physics_.full_step_deg));
  angle_deg += settling_deg(index, time_s);
  const bool follows = table_units != segment.table || physics_.backlash_deg == 0;
  const double rate_deg_s =
      follows ? segment.rate_at(time_s) * (1 + physics_.scale) / physics_.units_per_deg : 0;
  return {angle_deg * deg, rate_deg_s * deg};
}

}  // namespace sim
