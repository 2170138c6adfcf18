// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/steady_echoes.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <random>

#include "fit/numeric/angle.hpp"

namespace steady_echoes_test {
namespace {

using fit::explain::Cell;

constexpr int scans = 12;
constexpr double sd_of_sample = 4;

/// Beams across one target, a quarter of a degree apart, whose counts waver about those.
std::vector<Cell> cells_of(const std::function<double(int beam)>& counts, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, sd_of_sample / std::sqrt(scans));
  std::vector<Cell> cells(80);
  for (std::size_t i = 0; i < cells.size(); ++i) {
    Cell& cell = cells[i];
    cell.beam_rad = static_cast<double>(i) * 0.25 * fit::rad_per_deg;
    cell.n = scans;
    cell.usable = true;
    cell.at.target = 0;
    cell.intensity_sd = sd_of_sample;
    cell.at.intensity = counts(static_cast<int>(i)) + noise(random);
  }
  return cells;
}

/// Root mean square of what is off over some beams.
double off(const std::vector<Cell>& cells, const std::function<double(int beam)>& counts, int from, int to) {
  double sum = 0;
  for (int i = from; i < to; ++i)
    sum += std::pow(cells[static_cast<std::size_t>(i)].at.intensity - counts(i), 2);
  return std::sqrt(sum / (to - from));
}

}  // namespace

TEST_CASE("the echoes of a slanted board waver less with those of their neighbours") {
  const auto counts = [](int beam) { return 80 * std::exp(-0.01 * beam); };
  for (unsigned seed = 1; seed <= 5; ++seed) {
    std::vector<Cell> cells = cells_of(counts, seed);
    const double before = off(cells, counts, 0, 80);
    fit::explain::reduction::steady_echoes(cells);
    CHECK(off(cells, counts, 0, 80) < 0.55 * before);
  }
}

TEST_CASE("where another print begins, echoes stay as bright as they are") {
  const auto counts = [](int beam) { return beam < 40 ? 300.0 : 120.0; };
  std::vector<Cell> cells = cells_of(counts, 7);
  const double own = sd_of_sample / std::sqrt(scans);
  fit::explain::reduction::steady_echoes(cells);
  CHECK(off(cells, counts, 36, 44) < 2 * own);
  CHECK(off(cells, counts, 0, 36) < 0.6 * own);
}

TEST_CASE("an echo is no neighbour's that comes from another target or has none of its own") {
  const auto counts = [](int beam) { return beam < 40 ? 300.0 : 302.0; };
  std::vector<Cell> cells = cells_of(counts, 8);
  for (std::size_t i = 40; i < cells.size(); ++i) cells[i].at.target = 1;
  cells[10].usable = false;
  const double before = cells[10].at.intensity;
  fit::explain::reduction::steady_echoes(cells);
  CHECK(cells[10].at.intensity == before);
  CHECK(off(cells, counts, 36, 44) < 1);
}

}  // namespace steady_echoes_test
