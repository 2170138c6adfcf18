// SPDX-License-Identifier: MIT
#pragma once

#include <deque>

#include "sim/engine.hpp"

namespace sim {

/// The causes of a rotary stage's motion and of its errors. An amplitude of 0 switches a cause off. Numbers
/// found for real stages are quoted with their sources in docs/operate/stages.md.
struct StagePhysics {
  double units_per_deg =
      1536000.0 / 360;  ///< Motor units (microsteps, pulses) in a degree: 120:1, 1.8 deg, 64 microsteps.
  double speed_deg_s = 20, acceleration_deg_s2 = 100;
  double homing_speed_deg_s = 20;
  double min_deg = -3600, max_deg = 3600;  ///< Hard ends, from the home switch.
  double power_on_deg = 0;                 ///< Where the table stands at power-on, from the home switch.

  double backlash_deg = 0;  ///< Play of the gear: width of the dead zone on reversal.
  double worm_deg = 0, worm_teeth = 120, worm_phase_deg = 0;  ///< Worm run-out: amplitude, periods per turn.
  double wheel_deg = 0, wheel_phase_deg = 0;    ///< Worm wheel off its axis: amplitude, once per turn.
  double scale = 0;                             ///< True angle is (1 + scale) times the counted one.
  double motor_deg = 0, full_step_deg = 0.015;  ///< Microstep error, amplitude; its period is 4 full steps.
  double spring_hz = 0,
         spring_damping = 0.05;       ///< The rotor on its magnetic spring: rings when it is stopped.
  double creep_deg = 0, creep_s = 1;  ///< Lags so much at rest and catches up with this time constant.
};

/// How a stage moves: trapezoidal motion of the motor in simulated time, and the table's true angle behind
/// play, gear errors, ringing and creep. Pure: time is handed in, no random numbers. `position_units` is what
/// the controller counts; `truth` is where the table is. After lost steps or before homing the two have no
/// fixed relation.
class StageMechanics {
 public:
  explicit StageMechanics(const StagePhysics& physics);

  [[nodiscard]] const StagePhysics& physics() const { return physics_; }
  /// Speed and acceleration of the moves that follow.
  void set_speed(double units_per_s) { speed_ = units_per_s; }
  void set_acceleration(double units_per_s2) { acceleration_ = units_per_s2; }
  [[nodiscard]] double speed() const { return speed_; }
  [[nodiscard]] double acceleration() const { return acceleration_; }

  /// Commands replace the motion under way, from its present speed. Positions are in counted units.
  void move_to(double now_s, double target_units);
  void turn(double now_s, double units_per_s);
  void stop(double now_s);  ///< Decelerates.
  void halt(double now_s);  ///< Stands at once.
  /// Moves to the home switch and counts from there; homed() from then on. Some controllers run past it
  /// first, by `overrun_units`, as far as the limit switch.
  void home(double now_s, double overrun_units = 0);
  /// Counts from here on as if the present position were `units`.
  void count_from(double now_s, double units);

  [[nodiscard]] double position_units(double time_s) const;
  [[nodiscard]] double rate_units_s(double time_s) const;
  [[nodiscard]] bool moving(double time_s) const;
  [[nodiscard]] bool homed(double time_s) const { return time_s >= homed_from_s_; }
  [[nodiscard]] bool homing(double time_s) const { return homed_from_s_ < never_s && time_s < homed_from_s_; }
  /// When the motor stands and ringing and creep have died to 1 %, if nothing more is commanded; long past
  /// while it turns without end.
  [[nodiscard]] double rest_s() const;
  /// The hard ends, in counted units.
  [[nodiscard]] double min_units(double time_s) const;
  [[nodiscard]] double max_units(double time_s) const;
  /// The table's true angle and rate, at any time since some seconds before the last command.
  [[nodiscard]] StageMoment truth(double time_s) const;

  // Faults.
  /// The rotor slips by so many full steps: the table moves and the counter does not notice.
  void slip(double now_s, double full_steps);
  /// The rotor stands still, the counter knows: what a stalled stage with an encoder does.
  void stall(double now_s) { halt(now_s); }
  /// Power-off and on: counts from 0 where it stands, not homed.
  void power_cycle(double now_s);

 private:
  static constexpr double never_s = 1e300;
  /// A piece of motion with constant acceleration, which never reverses within.
  struct Segment {
    double start_s, motor, rate, acceleration;
    double table;  ///< The table behind the play, in units, at its start.
    [[nodiscard]] double motor_at(double time_s) const;
    [[nodiscard]] double rate_at(double time_s) const { return rate + acceleration * (time_s - start_s); }
  };
  [[nodiscard]] std::size_t segment_at(double time_s) const;
  [[nodiscard]] double table_at(const Segment& segment, double time_s) const;
  [[nodiscard]] double settling_deg(std::size_t index, double time_s) const;
  [[nodiscard]] double counter_offset(double time_s) const;
  [[nodiscard]] double settle_s() const;
  /// Cuts what was planned after `now_s`.
  void cut(double now_s);
  void forget_before(double time_s);
  void append(double start_s, double rate, double acceleration);
  void plan_to(double now_s, double motor_target, double speed);
  void plan_rate(double now_s, double rate);

  StagePhysics physics_;
  double speed_, acceleration_;
  std::deque<Segment> segments_;
  double offset_ = 0;              ///< Motor position minus counter, since `homed_from_s_` 0 or ...
  double offset_before_home_ = 0;  ///< ... until then.
  double homed_from_s_ = never_s;
};

}  // namespace sim
