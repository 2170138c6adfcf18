// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "fit/bench/bench.hpp"
#include "sim/engine.hpp"

namespace sim {

/// A target as it really is, where that differs from what the bench says.
struct TargetTruth {
  double offset_mm = 0;     ///< Along its outward normal.
  double aside_mm = 0;      ///< Of a round one: across that, counter-clockwise.
  double thicker_mm = 0;    ///< Of a round one: its radius.
  double tilt_rad = 0;      ///< In the plan, about its middle.
  double plumb_rad = 0;     ///< Out of the vertical; matters where beams rise.
  double sagitta_mm = 0;    ///< Bent to a circle; positive: its middle is farther away.
  double reflectance = -1;  ///< Negative: as the bench says.
  double gloss = 0;         ///< Amplitude of a mirror-like reflection (second echo by way of other targets).
  double specular = 0;      ///< Extra echo square on, relative to the diffuse one ...
  double specular_width_rad = 0.05;
  double depth_mm = 0;  ///< Mean depth from which light comes back (translucent material).
  struct Stripe {
    double from_mm = 0, to_mm = 0, reflectance = 0;
  };
  std::vector<Stripe> stripes = {};  ///< Places along the target, from its middle.
  /// Pushed after that time since power-on, and put back after the other.
  struct Move {
    double from_s = 0, to_s = 1e9, offset_mm = 0, turn_rad = 0, aside_mm = 0;
  } moved = {};
};

/// Everything that makes up a device and its room, as causes. The defaults are a good device without faults.
/// docs/develop/worlds.md explains every key of the file this is read from.
struct World {
  fit::Bench bench;  ///< What the operator knows.

  std::optional<double> mount_x_mm, mount_y_mm, mount_yaw_rad;  ///< True values; absent: as the bench says.
  /// The lidar is knocked about on the stage, so long after power-on.
  struct Knock {
    double from_s = 0, x_mm = 0, y_mm = 0, yaw_rad = 0;
  } knock;
  std::map<std::string, TargetTruth> targets;

  struct Beam {
    double long_rad = 3e-3;  ///< Full divergence along the footprint's long axis ...
    double short_rad =
        2.5e-3;              ///< ... and its short one; the long one lies in the scan plane straight ahead.
    double aperture_mm = 4;  ///< Width with which it leaves the window.
    double aside_mm = 0;     ///< By how much it misses the mirror's axis.
  } beam;

  struct Pulse {
    std::string shape = "gaussian";  ///< "gaussian", "two-pole" or "raised-cosine".
    double rise_ns = 2;              ///< Standard deviation, or comparable scale, of its leading edge.
  } pulse;

  struct Receiver {
    std::string timing =
        "threshold";             ///< "threshold", "fraction" (of the peak) or "centre" (of the time above).
    std::string echo = "first";  ///< "first" or "strongest".
    double threshold = 0.004;    ///< 1: echo of a white target, square on, at 1 m.
    double fraction = 0.5;
    double compensation = 1;       ///< Share of the nominal walk that the firmware takes away.
    double noise = 2.5e-4;         ///< White electronic noise (standard deviation at the comparator).
    double photon_noise = 0;       ///< Adds photon_noise * sqrt(signal) at the comparator.
    double wander = 0;             ///< Slow baseline, common to a scan ...
    double wander_memory_s = 0.5;  ///< ... with this memory.
    double memory = 0;             ///< Memory of one beam's time from scan to scan (0..1).
    double clip = 1e9;             ///< Largest signal it can give.
    double overlap_mm = 60;        ///< Range at which half the echo reaches the detector.
    double parallax_mm = 0;        ///< Distance between emitter and detector.
    double stray = 0;  ///< Share of the light of beams up to `stray_width` beside that is received.
    double stray_width_rad = 0.01;
    double counts = 900;  ///< Intensity at 1 m from white, and its power law ...
    double counts_exponent = 0.5;
    double counts_full = 2800;  ///< ... which bends over towards this.
    double counts_noise = 0;    ///< Relative noise of the peak detector that makes the intensity.
  } receiver;

  struct Counter {
    double bin_ns = 0;         ///< Bins of the time counter; 0: as fine as one likes.
    double ppm = 0;            ///< Error of its clock.
    double jitter_ns = 0;      ///< Random error of every reading ...
    double jitter_memory = 0;  ///< ... which may remember the scan before (0..1).
    double leak = 0;           ///< Its clock's leak into the comparator.
    double leak_mhz = 100;
    double leak_phase_rad = 0;
  } counter;

  struct Housing {
    double delay_ns = 0;  ///< Of cables and window beyond what was calibrated.
    double flash = 0;  ///< Light of the own pulse thrown back inside (negative: the receiver's undershoot).
    double flash_decay_ns = 2;
    double glint = 0;  ///< The same from one place of the window only.
    double glint_centre_rad = 0, glint_width_rad = 0.3;
    struct Dirt {
      double centre_rad = 0, width_rad = 0.1, loss = 0;
      double there = 1;  ///< Share of measurements in which it is: a thread that flutters.
    };
    std::vector<Dirt> dirt;
  } housing;

  struct Rotor {
    double disk_offset = 0;  ///< Code disk's centre off the axis, over its radius.
    double disk_phase_rad = 0;
    double disk_lean_rad = 0;  ///< Code disk leaning on its axis.
    double disk_lean_phase_rad = 0;
    double speed_error = 0;        ///< Relative; the firing clock starts right at the front.
    double ripple_rad = 0;         ///< Cogging of the motor ...
    int ripple_order = 6;          ///< ... that many times a turn.
    double lost_slit_rad = 0;      ///< Angles behind a lost slit of the disk are off by this ...
    double lost_slit_at_rad = 0;   ///< ... from that beam on.
    double interpolation_rad = 0;  ///< Sawtooth between two slits: its amplitude ...
    int slits = 0;                 ///< ... and their number.
    double index_jitter_rad = 0;   ///< Of the index pulse: one draw a scan.
    double plane_tilt_rad = 0, plane_axis_rad = 0;
    bool rolling = true;  ///< Beams are fired one after the other.
    struct Facet {
      double range_mm = 0, angle_rad = 0;
    };
    std::vector<Facet> facets;  ///< Empty: one face.
  } rotor;

  struct Heat {
    double rise_fast_k = 8, fast_s = 300;   ///< Self-heating of the electronics ...
    double rise_slow_k = 6, slow_s = 1500;  ///< ... and of the housing.
    double delay_ps_per_k = 0;
    double gain_per_k = 0;
    double reference_c = 25;  ///< Where delay and gain were calibrated.
  } heat;

  struct Stage {
    double worm_rad = 0, worm_second = 0;  ///< Run-out of the worm and its second harmonic's share.
    int worm_teeth = 120;
    double worm_phase_rad = 0;
    double wheel_rad = 0, wheel_phase_rad = 0;
    double scale = 0;
    double play_rad = 0;
    double runout_mm = 0, runout_phase_rad = 0;
    double wobble_rad = 0, wobble_phase_rad = 0;
    double ring_rad = 0, ring_hz = 8, ring_decay_s = 0.2;
    double late_s = 0;  ///< Time stamps of its angle come that late.
  } stage;

  struct Light {
    struct Sun {
      double centre_rad = 0, width_rad = 0.2;  ///< Beam angles.
      double noise = 0;                        ///< At the comparator.
      double from_s = 0, to_s = 1e12;
      double in_room = 0;  ///< By how much of the stage's turn it moves through the beams.
    };
    std::vector<Sun> suns;
    double lamp = 0, lamp_hz = 100;  ///< Flicker at the comparator.
  } light;

  struct Air {
    double dust_per_m = 0;   ///< Chance of a grain per metre.
    double index_error = 0;  ///< Group index minus the one the firmware assumes.
  } air;

  struct Firmware {
    double step_mm = 1;
    int median = 1;  ///< Window over neighbouring beams.
  } firmware;
};

/// Reads a world file (JSON with comments). Its "bench" is used unless `bench` is given. Throws
/// std::invalid_argument naming file, line and column, the key, and what was expected.
World parse_world(const std::string& text, const std::string& name = "world",
                  const std::optional<fit::Bench>& bench = std::nullopt);

/// Reads a world file from disk; "bench_file" in it is relative to its folder. Throws std::invalid_argument.
World load_world(const std::filesystem::path& path, const std::optional<fit::Bench>& bench = std::nullopt);

/// The bench file of a world with its effects concealed: the geometry and mechanisms that the operator knows,
/// and the range noise one measures on such a device. JSON text.
std::string compile_world(const World& world);

/// The causal engine: rays, pulses, gears and heat, see sim/causal/. `exact_mm` and `exact_counts`, if given,
/// receive with every scan the ranges before rounding (NaN: no echo); it must outlive the engine.
std::unique_ptr<Engine> make_causal_engine(const World& world, std::uint64_t seed,
                                           std::vector<double>* exact_mm = nullptr,
                                           std::vector<double>* exact_counts = nullptr);

}  // namespace sim
