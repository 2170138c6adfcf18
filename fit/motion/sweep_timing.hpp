// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "fit/motion/deskew.hpp"
#include "fit/numeric/estimate.hpp"

namespace fit {

struct TimingEstimate {
  SweepTiming timing;
  Estimate offset_s;  ///< With its uncertainty, by resampling the pairs of scans it is made from.
  bool determined = false;
  double disagreement_mm = 0;        ///< Of overlapping scans, at the best timing.
  double disagreement_other_mm = 0;  ///< At the best timing with the other order of beams; 0: not tried.
  std::vector<double> tried_s, score_mm;
};

struct TimingOptions {
  double widest_s = 0.2;         ///< Offsets up to this are tried, both ways.
  std::optional<bool> reversed;  ///< Order of the beams; without it, judged: reversed only if clearly better.
  bool drifts = true;            ///< Path of a stage (false): scans of different captures are compared too.
  double about_s = 0;            ///< The offset in the middle of those tried.
  int steps = 40;                ///< Offsets tried on either side.
};

/// Finds the time offset at which scans, placed by the path alone, agree best: scans four apart, or, on a
/// stage, scans from about the same angle taken while it turned at different rates. Only motion that differs
/// tells it.
TimingEstimate estimate_timing(std::span<const Sweep> sweeps, const Path& path, const Pose2& lidar,
                               const TimingOptions& options = {});

}  // namespace fit
