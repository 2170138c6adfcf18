// SPDX-License-Identifier: MIT
#include "fit/explain/model/combs.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <functional>
#include <unsupported/Eigen/FFT>
#include <utility>

namespace fit::explain::model {
namespace {

struct Line {
  double strength = 0, frequency = 0;
};

/// The strongest lines of the score's spectrum along the coordinate that rounding to a multiple may make.
std::vector<Line> lines_of(const Scores& scores, const Parameter& bins) {
  constexpr std::size_t kept = 40;
  constexpr double places_of_shortest = 4, finer = 4;
  constexpr std::size_t longest_grid = 1 << 20;
  const auto [least, most] = std::ranges::minmax(scores.place);
  const double step = std::max(bins.lower / places_of_shortest, finer * (most - least) / longest_grid);
  std::size_t size = 256;
  while (static_cast<double>(size) * step < finer * (most - least) && size < longest_grid) size *= 2;
  std::vector<double> grid(size, 0.0);
  for (std::size_t i = 0; i < scores.place.size(); ++i)
    grid[std::min(size - 1, static_cast<std::size_t>((scores.place[i] - least) / step + 0.5))] +=
        scores.score[i];
  std::vector<std::complex<double>> spectrum;
  Eigen::FFT<double> transform;
  transform.fwd(spectrum, grid);
  std::vector<Line> lines;
  for (std::size_t k = 1; k < size / 2; ++k) {
    const double frequency = static_cast<double>(k) / (static_cast<double>(size) * step);
    if (frequency < 1 / bins.upper || frequency > 1 / bins.lower) continue;
    // Rounding reads short just above a multiple: minus a sine.
    lines.push_back({std::imag(spectrum[k] * std::polar(1.0, -2 * pi * frequency * least)), frequency});
  }
  const auto stronger = [](const Line& a, const Line& b) { return a.strength > b.strength; };
  const std::size_t count = std::min(kept, lines.size());
  std::ranges::partial_sort(lines, lines.begin() + static_cast<std::ptrdiff_t>(count), stronger);
  lines.resize(count);
  return lines;
}

double along_comb(const Scores& scores, double bin) {
  double sum = 0;
  for (std::size_t i = 0; i < scores.place.size(); ++i)
    sum += scores.score[i] * (bin * std::round(scores.place[i] / bin) - scores.place[i]);
  return sum / bin;
}

}  // namespace

std::vector<double> bins_in(const Scores& scores, const Parameter& bins) {
  constexpr std::size_t kept = 6;
  if (scores.place.size() < kept) return {};
  const auto [least, most] = std::ranges::minmax(scores.place);
  const double within_a_line = 1 / (16 * (most - least + bins.upper));
  std::vector<std::pair<double, double>> tried;
  for (const Line& line : lines_of(scores, bins))
    for (int k = -2; k <= 2; ++k) {
      const double bin = std::clamp(1 / (line.frequency + k * within_a_line), bins.lower, bins.upper);
      tried.emplace_back(along_comb(scores, bin), bin);
    }
  const std::size_t count = std::min(kept, tried.size());
  std::ranges::partial_sort(tried, tried.begin() + static_cast<std::ptrdiff_t>(count), std::greater<>());
  std::vector<double> list;
  for (std::size_t i = 0; i < count; ++i) list.push_back(tried[i].second);
  return list;
}

}  // namespace fit::explain::model
