// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "fit/explain/reduction/reduce.hpp"
#include "fit/explain/reduction/selected_captures.hpp"
#include "fit/explain/reduction/together.hpp"

namespace fit::explain {

/// Recordings of one lidar, read before one bench and reduced, without what says nothing of lidar and
/// targets: captures in clusters or from elsewhere than stated, what stood before the targets, dead beams.
class Reading {
 public:
  /// Borrows the recordings. `keep_samples`: in Reduced::kept. Throws std::invalid_argument where nothing can
  /// be compared with the bench.
  Reading(const std::vector<const Recording*>& recordings, const Progress& progress,
          bool keep_samples = false);

  /// Given away, as it is large.
  [[nodiscard]] Reduced take_reduced() { return std::move(reduced_); }
  [[nodiscard]] const Together& together() const { return *together_; }
  /// What was left out, and why: sentences for the operator.
  [[nodiscard]] const std::vector<std::string>& notes() const { return notes_; }

 private:
  /// Reads the captures that are kept. Returns what stood before their targets.
  std::vector<Occluder> read(const Progress& progress);

  std::vector<SelectedCaptures> single_, kept_;  ///< Of single beams; of these, those that fit somewhere.
  std::unique_ptr<Together> together_;
  bool keep_samples_;
  Reduced reduced_;
  std::vector<std::string> notes_;
};

}  // namespace fit::explain
