// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/expected_echo.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fit::explain::reduction {
namespace {

double counts_of(const Cell& cell) {
  return cell.usable && cell.n > 1 && std::isfinite(cell.counts) ? cell.counts : 0;
}

}  // namespace

ExpectedEcho::ExpectedEcho(const std::vector<const Circumstances*>& known) {
  // Exponents are near those of a plain receiver, if only echoes hardly differ.
  Eigen::Matrix4d square = Eigen::Vector4d(1e-9, 1, 1, 1).asDiagonal();
  Eigen::Vector4d along = square * Eigen::Vector4d(0, -2, 1, 1);
  for (const Circumstances* at : known) {
    const Eigen::Vector4d x = powers(*at);
    square += x * x.transpose();
    along += x * std::log(at->intensity);
  }
  exponents_ = square.ldlt().solve(along);
  if (known.empty()) exponents_.setConstant(std::numeric_limits<double>::quiet_NaN());
}

double ExpectedEcho::operator()(const Circumstances& at) const {
  return std::exp(exponents_.dot(powers(at)));
}

Eigen::Vector4d ExpectedEcho::powers(const Circumstances& at) {
  return {1, std::log(std::max(1.0, at.range_mm) / 1000), std::log(std::max(0.05, at.cos_incidence)),
          std::log(std::max(0.001, at.reflectance))};
}

EndOfCounts::EndOfCounts(const Reduced& reduced) {
  constexpr double well_below = 0.9;
  for (const Cell& cell : reduced.cells) counts = std::max(counts, counts_of(cell));
  for (const Cell& cell : reduced.cells) {
    if (!(counts_of(cell) > 0)) continue;
    below += counts_of(cell) < well_below * counts;
    if (!is_at_it(cell)) continue;
    ++cells;
    const double power = cell.at.reflectance * cell.at.cos_incidence / std::pow(cell.at.range_mm, 2);
    weakest = std::min(weakest, power);
    strongest = std::max(strongest, power);
  }
}

bool EndOfCounts::is_reached() const {
  constexpr int fewest = 20;
  constexpr double clearly = 1.3;  // times as strong
  return cells >= fewest && below >= fewest && strongest > clearly * weakest;
}

bool EndOfCounts::is_at_it(const Cell& cell) const {
  constexpr double alike = 0.99;
  return counts_of(cell) >= alike * counts;
}

void expect_beyond_end_of_counts(Reduced& reduced) {
  const EndOfCounts end(reduced);
  if (!end.is_reached()) return;
  std::vector<const Circumstances*> below;
  for (const Cell& cell : reduced.cells)
    if (counts_of(cell) > 0 && !end.is_at_it(cell)) below.push_back(&cell.at);
  const ExpectedEcho expected(below);
  for (Cell& cell : reduced.cells)
    if (end.is_at_it(cell)) cell.at.intensity = std::max(cell.at.intensity, expected(cell.at));
}

}  // namespace fit::explain::reduction
