// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <vector>

#include "lidar/scan.hpp"
#include "rig/runner/target_detection.hpp"

namespace rig {

/// The echoes of some neighbouring beams over a few scans, until they can be judged.
class Echoes {
 public:
  explicit Echoes(std::size_t beams) : ranges_(beams), levels_(beams) {}
  /// `offset`: index of the first of these beams within the scan.
  void add(const lidar::Scan& scan, std::size_t offset);
  [[nodiscard]] bool enough() const;
  /// Medians of the beams that had an echo in half of the scans.
  [[nodiscard]] BeamMedians seen() const;

 private:
  std::vector<std::vector<double>> ranges_, levels_;
  int scans_ = 0;
};

}  // namespace rig
