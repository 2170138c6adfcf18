// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "rig/import/importer.hpp"

namespace rig {

/// Watches the scans of one file and says what in them cannot be: a wrong unit or a wrong rate would else
/// become a wrong calibration.
class Plausibility {
 public:
  void scan(const ImportedScan& scan);
  /// Sentences with what to do; empty when all is plausible. `true_mm`: the distance that the operator gives
  /// for a target ahead of the lidar.
  [[nodiscard]] std::vector<std::string> doubts(std::optional<double> true_mm) const;
  /// How often scans were taken, by their stamps; nothing for fewer than three scans.
  [[nodiscard]] std::optional<double> stamped_hz() const;

 private:
  [[nodiscard]] std::optional<double> usual_interval_s() const;

  std::uint64_t scans_ = 0, echoes_ = 0, timed_ = 0;
  std::int64_t first_ns_ = 0, last_ns_ = 0;
  double turn_s_sum_ = 0;
  std::vector<float> interval_s_;
  std::vector<std::uint16_t> ahead_mm_;  ///< Middle range within 10 deg of the x axis, scan by scan.
};

}  // namespace rig
