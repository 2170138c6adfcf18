// SPDX-License-Identifier: MIT
#include "fit/explain/model/combs.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <functional>
#include <unsupported/Eigen/FFT>
#include <utility>

#include "fit/explain/model/extent.hpp"

namespace fit::explain::model {
namespace {

struct Line {
  double strength = 0, frequency = 0;
  std::complex<double> amplitude;
};

Extent extent_of(const std::vector<RowScore>& rows) {
  Extent places;
  for (const RowScore& row : rows) places.add(row.place);
  return places;
}

/// The strongest lines of the score's spectrum along the coordinate that rounding to a multiple may make.
std::vector<Line> lines_of(const std::vector<RowScore>& rows, const Parameter& bins, bool any_zero) {
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
  Eigen::FFT<double> transform(Eigen::default_fft_impl<double>(), Eigen::FFT<double>::HalfSpectrum);
  transform.fwd(spectrum, grid);
  const double spacing = 1 / (static_cast<double>(size) * step);
  const std::complex<double> next = std::polar(1.0, -2 * pi * spacing * places.low);
  std::complex<double> from_zero(1, 0);  // turns a line's phase to where the coordinate is zero
  std::vector<Line> lines;
  for (std::size_t k = 1; k < size / 2; ++k) {
    from_zero *= next;
    const double frequency = static_cast<double>(k) * spacing;
    if (frequency < 1 / bins.upper || frequency > 1 / bins.lower) continue;
    // Rounding reads short just above a multiple: minus a sine.
    const std::complex<double> line = spectrum[k] * from_zero * std::complex<double>(0, -1);
    lines.push_back({any_zero ? std::norm(line) : std::real(line), frequency, line});
  }
  keep_best(kept, lines, &Line::strength);
  return lines;
}

constexpr int zeros_aside = 2, zeros = 2 * zeros_aside + 1;
constexpr double zero_step = 1.0 / 16;

/// Along combs of one bin: the one that is given in the middle, and others with their zeros beside its.
std::array<double, zeros> along_combs(const std::vector<RowScore>& rows, const Comb& comb) {
  std::array<double, zeros> sums{};
  for (const RowScore& row : rows) {
    const double counted = row.place / comb.bin + comb.zero, part = counted - std::floor(counted);
    for (int j = 0; j < zeros; ++j) {
      const double x = part + (j - zeros_aside) * zero_step;  // more than -0.5, less than 1.5
      sums[static_cast<std::size_t>(j)] += row.score * ((x < 0.5 ? 0 : 1) - x);
    }
  }
  return sums;
}

}  // namespace

std::vector<Comb> combs_in(const std::vector<RowScore>& rows, const Parameter& bins, bool any_zero) {
  constexpr std::size_t kept = 6;
  if (rows.size() < kept) return {};
  const Extent places = extent_of(rows);
  const double within_a_line = 1 / (16 * (places.length() + bins.upper)),
               middle = (places.low + places.high) / 2;
  std::vector<std::pair<double, Comb>> tried;
  for (const Line& line : lines_of(rows, bins, any_zero)) {
    const double of_line = std::arg(line.amplitude) / (2 * pi);
    for (int k = -2; k <= 2; ++k) {
      const double bin = std::clamp(1 / (line.frequency + k * within_a_line), bins.lower, bins.upper);
      // Another bin about the same teeth in the middle.
      const double zero = any_zero ? of_line + middle * (line.frequency - 1 / bin) : 0;
      const std::array<double, zeros> sums = along_combs(rows, {bin, zero});
      for (int j = 0; j < zeros; ++j) {
        if (!any_zero && j != zeros_aside) continue;
        const double there = zero + (j - zeros_aside) * zero_step;
        tried.emplace_back(sums[static_cast<std::size_t>(j)], Comb{bin, there - std::floor(there)});
      }
    }
  }
  keep_best(kept, tried, [](const auto& one) { return one.first; });
  std::vector<Comb> list;
  for (const auto& [sum, comb] : tried) list.push_back(comb);
  return list;
}

}  // namespace fit::explain::model
