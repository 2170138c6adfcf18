// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "fit/recording.hpp"

namespace fit::explain {

/// A recording without the captures in which the lidar merged neighbouring steps (SCIP's cluster count). Of a
/// cluster it sends the nearest range: the smallest of several noisy readings, across a slanted wall the near
/// end's. That is shorter than any single beam's, by no physics that could be missing, and scatters less.
class SingleBeams : public Forwarded {
 public:
  /// Borrows the recording.
  explicit SingleBeams(const Recording& recording);

  [[nodiscard]] const std::vector<CaptureInfo>& captures() const override { return captures_; }
  void for_each_scan(std::size_t index, const std::function<void(const ScanView&)>& visit) const override {
    Forwarded::for_each_scan(kept_[index], visit);
  }
  /// How many captures were left out.
  [[nodiscard]] std::size_t left_out() const { return Forwarded::captures().size() - captures_.size(); }

 private:
  std::vector<CaptureInfo> captures_;
  std::vector<std::size_t> kept_;  ///< Their indices in the recording.
};

/// All of them without clusters, in their order. Throws std::invalid_argument if captures were recorded and
/// none is left.
[[nodiscard]] std::vector<SingleBeams> single_beams(const std::vector<const Recording*>& recordings);

/// A sentence for the operator; empty if nothing was left out.
[[nodiscard]] std::string note_on_clusters(const std::vector<SingleBeams>& recordings);

}  // namespace fit::explain
