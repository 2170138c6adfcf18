// SPDX-License-Identifier: MIT
#include "fit/explain/model/combs.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <functional>
#include <unsupported/Eigen/FFT>
#include <utility>

#include "fit/explain/extent.hpp"

namespace fit::explain::model {
namespace {

struct Line {
  double strength = 0, frequency = 0;
};

Extent extent_of(const std::vector<RowScore>& rows) {
  Extent places;
  for (const RowScore& row : rows) places.add(row.place);
  return places;
}

/// The strongest lines of the score's spectrum along the coordinate that rounding to a multiple may make.
std::vector<Line> lines_of(const std::vector<RowScore>& rows, const Parameter& bins) {
  constexpr std::size_t kept = 40;
  constexpr double places_of_shortest = 4, finer = 4;
  constexpr std::size_t longest_grid = 1 << 20;
  const Extent places = extent_of(rows);
  const double step = std::max(bins.lower / places_of_shortest, finer * places.length() / longest_grid);
  std::size_t size = 256;
  while (static_cast<double>(size) * step < finer * places.length() && size < longest_grid) size *= 2;
  std::vector<double> grid(size, 0.0);
  for (const RowScore& row : rows)
    grid[std::min(size - 1, static_cast<std::size_t>((row.place - places.low) / step + 0.5))] += row.score;
  std::vector<std::complex<double>> spectrum;
  Eigen::FFT<double> transform;
  transform.fwd(spectrum, grid);
  std::vector<Line> lines;
  for (std::size_t k = 1; k < size / 2; ++k) {
    const double frequency = static_cast<double>(k) / (static_cast<double>(size) * step);
    if (frequency < 1 / bins.upper || frequency > 1 / bins.lower) continue;
    // Rounding reads short just above a multiple: minus a sine.
    lines.push_back({std::imag(spectrum[k] * std::polar(1.0, -2 * pi * frequency * places.low)), frequency});
  }
  keep_best(kept, lines, &Line::strength);
  return lines;
}

double along_comb(const std::vector<RowScore>& rows, double bin) {
  double sum = 0;
  for (const RowScore& row : rows) sum += row.score * (bin * std::round(row.place / bin) - row.place);
  return sum / bin;
}

}  // namespace

std::vector<double> bins_in(const std::vector<RowScore>& rows, const Parameter& bins) {
  constexpr std::size_t kept = 6;
  if (rows.size() < kept) return {};
  const Extent places = extent_of(rows);
  const double within_a_line = 1 / (16 * (places.length() + bins.upper));
  std::vector<std::pair<double, double>> tried;
  for (const Line& line : lines_of(rows, bins))
    for (int k = -2; k <= 2; ++k) {
      const double bin = std::clamp(1 / (line.frequency + k * within_a_line), bins.lower, bins.upper);
      tried.emplace_back(along_comb(rows, bin), bin);
    }
  keep_best(kept, tried, std::identity());
  std::vector<double> list;
  for (const auto& [sum, bin] : tried) list.push_back(bin);
  return list;
}

}  // namespace fit::explain::model
