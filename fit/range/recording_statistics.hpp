// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "fit/recording.hpp"

namespace fit {

/// One statistic of a recording: a sample of values, one for each small piece of it (a sector of a capture,
/// an edge, a neighbourhood of beams).
struct RecordingStatistic {
  std::string name, unit, what;
  std::vector<double> values;
};

/// A quantity against range, in steps of it.
struct RangeProfile {
  std::string name, unit;
  std::vector<double> range_mm, value, u;
};

struct RecordingStatistics {
  std::vector<RecordingStatistic> statistics;  ///< Always the same ones in the same order.
  std::vector<RangeProfile> profiles;
  long scans = 0, samples = 0;
};

struct StatisticsOptions {
  /// Beams that count for noise and intensity, in the lidar's frame. Edges are looked for at all beams.
  double from_rad = -pi, to_rad = pi;
  /// Only scans of this half of every capture: 0 all, 1 the first, 2 the second.
  int half = 0;
};

/// What a recording says about the device whatever stood before it: range noise and intensity noise from what
/// neighbouring beams of one scan deviate from a straight line (so that nothing needs to be known of the
/// scene, and scans may each have their own geometry), the shape of that noise, its memory, intensity, lost
/// echoes, and where between two surfaces the samples at edges lie.
[[nodiscard]] RecordingStatistics recording_statistics(const std::vector<const Recording*>& recordings,
                                                       const StatisticsOptions& options);

/// Largest distance between the two samples' distribution functions (Kolmogorov and Smirnov); NaN if one is
/// empty.
[[nodiscard]] double distribution_distance(std::vector<double> a, std::vector<double> b);

/// How often independent values of one distribution, so many on either side, lie that far apart or farther
/// (Kolmogorov's distribution with Stephens's correction for few values).
[[nodiscard]] double distance_probability(double distance, std::size_t values, std::size_t other_values);

}  // namespace fit
