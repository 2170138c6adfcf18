// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <optional>

namespace fit::explain::reduction {

/// Counts the mirror's turns between scans by the lidar's clock, which goes on between captures.
class TurnCounter {
 public:
  /// `scan_hz`: as the bench states it; 0: it does not.
  explicit TurnCounter(double scan_hz) : stated_ms_(scan_hz > 0 ? 1000 / scan_hz : 0) {}

  /// Turns from the first scan to the next one, which bears that time stamp.
  std::int64_t at(std::int64_t device_ms);

 private:
  [[nodiscard]] double period_ms() const;

  double stated_ms_;
  std::optional<std::int64_t> last_ms_;
  std::int64_t turn_ = 0, counted_ms_ = 0, counted_ = 0;
};

}  // namespace fit::explain::reduction
