// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace fit {

/// Mean, variance and correlation of neighbouring scans of every beam of one capture, in one pass. The sums
/// are whole numbers, therefore exact whatever the order; good for 2^31 scans.
class BeamStatistics {
 public:
  explicit BeamStatistics(std::size_t beams);

  /// One scan's ranges (mm; 0: no echo). Beams beyond those asked for are left out.
  void add(std::span<const std::uint16_t> range_mm);

  [[nodiscard]] std::size_t beams() const { return count_.size(); }
  [[nodiscard]] long scans() const { return scans_; }
  [[nodiscard]] long count(std::size_t beam) const { return count_[beam]; }  ///< Ranges.
  [[nodiscard]] double mean_mm(std::size_t beam) const;
  [[nodiscard]] double variance_mm2(std::size_t beam) const;  ///< Of one sample; needs two.
  /// Of one range with that before it; dropouts between them are passed over.
  [[nodiscard]] double correlation(std::size_t beam) const;

 private:
  /// Sums about the beam's first range keep their digits when they become floating.
  [[nodiscard]] double sum_about_first(std::size_t beam) const;

  long scans_ = 0;
  bool all_begun_ = false;  ///< Every beam has had a range.
  std::vector<std::uint32_t> count_, first_, last_;
  std::vector<std::uint64_t> sum_, square_, product_;
};

}  // namespace fit
