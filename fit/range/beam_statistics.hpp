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

  [[nodiscard]] std::size_t beams() const { return beams_; }
  [[nodiscard]] long scans() const { return scans_; }
  [[nodiscard]] long count(std::size_t beam) const { return sums(beam).count; }  ///< Ranges.
  [[nodiscard]] double mean_mm(std::size_t beam) const;
  [[nodiscard]] double variance_mm2(std::size_t beam) const;  ///< Of one sample; needs two.
  /// Of one range with that before it; dropouts between them are passed over.
  [[nodiscard]] double correlation(std::size_t beam) const;

 private:
  /// Of a beam's ranges about the first of them, which keeps their digits when they become floating.
  struct Sums {
    std::int64_t count = 0, sum = 0, square = 0, product = 0;
  };
  [[nodiscard]] Sums sums(std::size_t beam) const;

  std::size_t beams_;
  std::size_t row_;  ///< Beams, and "no echo" up to a whole number of vectors.
  long scans_ = 0;
  bool all_begun_ = false;  ///< Every beam has had a range.
  /// Scans wait here, one in a row, until there are as many as are worth fetching all sums for.
  std::vector<std::uint16_t> block_;
  std::size_t waiting_ = 0;
  std::vector<std::uint16_t> first_, last_;
  std::vector<std::uint32_t> count_;
  std::vector<std::int64_t> sum_, square_, product_;
};

}  // namespace fit
