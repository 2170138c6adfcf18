// SPDX-License-Identifier: MIT
// Worm, wheel, play, run-out and ringing of a rotary stage. The worm's error repeats with its turns (N teeth:
// N times a turn of the table), with a second harmonic from meshing; the wheel's and the scale's eccentricity
// once a turn. Play is the hysteresis operator of two flanks (Tao and Kokotovic, Adaptive Control of Systems
// with Actuator and Sensor Nonlinearities, 1996): the wheel is pushed, never pulled.
#include "sim/causal/turntable.hpp"

#include <algorithm>
#include <cmath>

namespace sim::causal {

void Turntable::drive(double time_s, double angle_rad, double rate_rad_s) {
  const double half = settings_.play_rad / 2;
  if (!started_) {
    started_ = true;
    last_angle_ = angle_rad;
    lag_ = -half;  // as after a move in the positive direction
  }
  const double moved = angle_rad - last_angle_;
  lag_ = std::clamp(lag_ - moved, -half, half);
  const bool was_moving = last_rate_ != 0 || moved != 0;
  if (moved != 0) direction_ = moved > 0 ? 1 : -1;
  if (was_moving && rate_rad_s == 0) stopped_s_ = time_s;
  last_angle_ = angle_rad;
  last_rate_ = rate_rad_s;
}

double Turntable::table_rad(double time_s, double angle_rad) const {
  const double worm = settings_.worm_teeth * angle_rad + settings_.worm_phase_rad;
  double table = angle_rad + lag_ + settings_.scale * angle_rad;
  table += settings_.worm_rad * (std::sin(worm) + settings_.worm_second * std::sin(2 * worm + 1));
  const double wheel = angle_rad + settings_.wheel_phase_rad;
  table += std::atan2(settings_.wheel_rad * std::sin(wheel), 1 - settings_.wheel_rad * std::cos(wheel));
  const double since = time_s - stopped_s_;
  if (settings_.ring_rad > 0 && last_rate_ == 0 && since >= 0 && since < 20 * settings_.ring_decay_s) {
    table += settings_.ring_rad * direction_ * std::exp(-since / settings_.ring_decay_s) *
             std::cos(2 * fit::pi * settings_.ring_hz * since);
  }
  return table;
}

Eigen::Vector2d Turntable::axis_mm(double table_rad) const {
  const double angle = table_rad + settings_.runout_phase_rad;
  return settings_.runout_mm * Eigen::Vector2d(std::cos(angle), std::sin(angle));
}

double Turntable::rise(double table_rad, double bearing) const {
  return std::sin(settings_.wobble_rad) * std::sin(bearing - table_rad - settings_.wobble_phase_rad);
}

}  // namespace sim::causal
