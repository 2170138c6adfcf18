// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "fit/bench/bench.hpp"

namespace fit {

/// How large a systematic deviation may be: its standard uncertainty (k = 1), and who says so.
struct Systematic {
  double u = 0;
  bool stated = false;  ///< By the bench file; else the usual size in the catalogue of mechanisms.
};

/// What a calibration allows for in its devices beyond the noise it sees. Every deviation is expected to be
/// zero; amplitudes of sines are of unknown phase.
struct DeviceAccuracy {
  Systematic stage_scale;             ///< Of the turn, per turn commanded.
  Systematic stage_eccentricity_rad;  ///< Amplitude of the error that repeats once a turn.
  Systematic stage_backlash_rad;      ///< Play between the two directions of approach.
  Systematic stage_position_rad;      ///< Of every stop on its own, beyond the resolution.
  Systematic beam_eccentricity_rad;   ///< The same of the lidar's encoder.
  Systematic range_offset_mm;         ///< Common to all ranges.
  Systematic range_scale;             ///< Per range.
  Systematic range_walk_mm;           ///< Of a weak echo against a strong one.
};

/// From the bench file's "stage": {"accuracy"} and "lidar": {"accuracy"}; what is not stated is the size that
/// the catalogue of mechanisms has for it, and nothing for the single stops.
[[nodiscard]] DeviceAccuracy accuracy_of(const Bench& bench);

/// One line of accuracy_of() for those who read a certificate.
struct AccuracyLine {
  std::string name, unit;
  double u = 0;
  bool stated = false;
  Systematic DeviceAccuracy::*member = nullptr;
  double per_unit = 1;  ///< Of `unit`, in what the member counts.
};
[[nodiscard]] std::vector<AccuracyLine> accuracy_in_words(const DeviceAccuracy& accuracy);

/// How much range walk an echo of that intensity has, as three curves that fade with growing intensity; each
/// counts range_walk_mm / sqrt(3).
inline constexpr int walk_curves = 3;
[[nodiscard]] double walk_curve(int which, double counts);

}  // namespace fit
