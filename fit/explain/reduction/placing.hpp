// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "fit/explain/reduction/reduce.hpp"
#include "fit/explain/reduction/samples.hpp"

namespace fit::explain::reduction {

/// A group of scans in its surroundings, by the bench file.
struct Setting {
  const CaptureInfo& capture;
  const Group& group;
  const Samples& samples;
  const Scene& scene;
  std::vector<Edge> edges;
};

/// Neighbouring columns that make one cell: one, or several where every scan has its own stage angle.
struct Beams {
  int first = 0, count = 1;

  /// Of values by column: that of the first beam, of the last one, and midway.
  [[nodiscard]] double from(const std::vector<double>& by_column) const {
    return by_column[static_cast<std::size_t>(first)];
  }
  [[nodiscard]] double to(const std::vector<double>& by_column) const {
    return by_column[static_cast<std::size_t>(first + count - 1)];
  }
  [[nodiscard]] double midway(const std::vector<double>& by_column) const {
    return (from(by_column) + to(by_column)) / 2;
  }
  /// Standard deviation of values that lie as far apart as their columns.
  [[nodiscard]] double spread(const std::vector<double>& by_column) const {
    const double n = count, apart = (to(by_column) - from(by_column)) / std::max(1.0, n - 1);
    return apart * std::sqrt(n * (n + 1) / 12);
  }
};

/// The cell of those beams without its samples: what they meet by the bench file, in which circumstances, and
/// whether their mean may be compared with it. Its target is -1 if they meet nothing.
[[nodiscard]] Cell placed(const Reduced& session, const Setting& setting, const Beams& beams);

/// Robust standard deviation (mm) of one sample: the median over beams of each beam's own; what the bench
/// states where nothing tells.
[[nodiscard]] double typical_spread(const Samples& samples, const Bench& bench);

/// Fills in what remains of the samples of a placed cell, and judges by them whether its mean may be
/// compared. The session counts them; `keep_samples`: and keeps those that belong to the target.
void summarise(const Setting& setting, const Beams& beams, bool keep_samples, Cell& cell, Reduced& session);

}  // namespace fit::explain::reduction
