// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "fit/explain/reduce.hpp"

namespace fit::explain::spread {

/// What one scan's cells say together of a common range (mm) and a common stage angle (rad): information and
/// score.
struct Scan {
  int group = 0, scans = 0;
  int capture = 0;
  double through_capture = 1;  ///< Share of its capture that has passed at its end.
  std::int64_t seq = 0;        ///< In its capture.
  std::int64_t counted = 0;    ///< In the recording.
  std::int64_t turn = 0;       ///< Of the mirror, by the lidar's clock.
  Eigen::Matrix2d information = Eigen::Matrix2d::Zero();
  Eigen::Vector2d score = Eigen::Vector2d::Zero();

  /// The same of the common range alone.
  [[nodiscard]] double range_information() const { return information(0, 0); }
  [[nodiscard]] double range_score() const { return score[0]; }
};

/// Variance of one sample of a group, mm^2: its typical spread, and the rounding to whole millimetres.
[[nodiscard]] double typical_variance(const Group& group);

/// All scans of a recording, in its order.
[[nodiscard]] std::vector<Scan> scans_of(const std::vector<Group>& groups,
                                         const std::vector<Sector>& sectors);

/// The same scans, weighed with what their beams scatter by, each for itself. Where noise differs from beam to
/// beam, a score scatters more than information says that supposes one noise for all (a "sandwich": White
/// 1980). Captures of many scans are weighed so already.
[[nodiscard]] std::vector<Scan> by_noise_of_beams(std::vector<Scan> scans, const Reduced& reduced);

/// How scans are counted: from 0 in every capture, through the recording, or with the mirror through the time
/// between captures as well.
using Numbering = std::int64_t Scan::*;
constexpr std::array<Numbering, 3> numberings{&Scan::seq, &Scan::counted, &Scan::turn};

}  // namespace fit::explain::spread
