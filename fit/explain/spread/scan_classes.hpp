// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "fit/explain/spread/scans.hpp"

namespace fit::explain::spread {

// Standard sizes of patterns that are tried, and the log of what trying costs.
constexpr double least_pattern_mm = 0.01, most_pattern_mm = 5, price_of_pattern_size = 2;

/// A pattern of scans' numbers: how much the log-likelihood gains by it, its log Bayes factor, and it in
/// words.
struct Pattern {
  double gain = 0, evidence = -1;
  std::string describes;
};

/// Scans of the longest capture.
[[nodiscard]] std::int64_t longest_capture(const std::vector<Scan>& scans);

/// Of the patterns that are tried: as many as a mirror may have faces, and fewer than the longest capture has
/// scans.
[[nodiscard]] std::size_t most_classes(const std::vector<Scan>& scans);

/// What scans of every class, their number modulo the number of classes, have in common: a range, mm.
class Classes {
 public:
  Classes(const std::vector<Scan>& scans, Numbering number, std::size_t modulus);

  [[nodiscard]] std::size_t size() const { return score_.size(); }
  [[nodiscard]] double value(std::size_t at) const {
    return information_[at] > 0 ? score_[at] / information_[at] : 0;
  }
  /// Its standard uncertainty, if scans scatter as their noise says.
  [[nodiscard]] double uncertainty(std::size_t at) const {
    return information_[at] > 0 ? 1 / std::sqrt(information_[at]) : 0;
  }
  /// Of a scan's class.
  [[nodiscard]] double value_at(const Scan& scan) const {
    return value(static_cast<std::size_t>(scan.*number_) % size());
  }
  /// Of all classes together, mm^-2.
  [[nodiscard]] double information() const;

  /// Log-likelihood that these values gain, and its evidence against a prior whose scale is searched.
  /// `inflate`: on the variance of scans.
  [[nodiscard]] Pattern pattern(double inflate) const;
  /// Squared scatter of scans within their classes, in units of their own noise; at least 1.
  [[nodiscard]] double scatter(const std::vector<Scan>& scans) const;
  /// Faces do not drift: a pattern that grows or fades within a capture, or from the first capture to the
  /// last, is something else.
  [[nodiscard]] bool grow_or_fade(const std::vector<Scan>& scans, double inflate) const;

 private:
  [[nodiscard]] double evidence_at(double scale_mm, double inflate) const;

  Numbering number_;
  std::vector<double> score_, information_;
};

}  // namespace fit::explain::spread
