// SPDX-License-Identifier: MIT
#include "fit/explain/model/neighbours.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <random>

#include "fit/explain/reduction/margins.hpp"

namespace neighbours_test {
namespace {

using fit::explain::Cell;
using fit::explain::Reduced;

/// Beams of one wall in some captures, each with the variance of so many such samples.
Reduced recorded(int samples, const std::function<double()>& sample) {
  Reduced reduced;
  for (int capture = 0; capture < 10; ++capture) {
    fit::explain::Group group;
    group.first_cell = reduced.cells.size();
    for (int beam = 0; beam < 300; ++beam) {
      double sum = 0, squares = 0;
      for (int i = 0; i < samples; ++i) {
        const double x = sample();
        sum += x;
        squares += x * x;
      }
      Cell cell;
      cell.usable = true;
      cell.n = samples;
      cell.at.target = 0;
      cell.variance_mm2 = (squares - sum * sum / samples) / (samples - 1);
      reduced.cells.push_back(cell);
    }
    group.last_cell = reduced.cells.size();
    reduced.groups.push_back(group);
  }
  return reduced;
}

}  // namespace

TEST_CASE("tails show in how variances of neighbours scatter, however few the samples") {
  std::mt19937 random(7);
  std::normal_distribution<double> normal(0, 2);
  std::bernoulli_distribution is_wide(0.02);
  const int samples = GENERATE(4, 8, 20);
  const auto narrow = [&] { return normal(random); };
  const auto tailed = [&] { return (is_wide(random) ? 3 : 1) * normal(random); };
  CHECK(fit::explain::model::inflation_of_variances(recorded(samples, narrow), 1) == 1);
  // (kurtosis - 1) / 2, and by 2 / (n - 1) less of it the fewer there are.
  const double kurtosis = 3 * (0.98 + 0.02 * 81) / ((0.98 + 0.02 * 9) * (0.98 + 0.02 * 9)),
               truth = 1 + (kurtosis - 3) / 2 * (samples - 1) / samples;
  CHECK(fit::explain::model::inflation_of_variances(recorded(samples, tailed), 1) ==
        Approx(truth).epsilon(0.2));
}

TEST_CASE("means beside the next bin of a comb may be half a bin off, others are as they were") {
  Reduced reduced = recorded(8, [] { return 0.0; });
  for (std::size_t i = 0; i < reduced.cells.size(); ++i)
    reduced.cells[i].at.range_mm = 2000 + 0.5 * static_cast<double>(i % 20);
  fit::explain::reduction::state_u_of_bin_edges(reduced, 10, 0, 0);  // bins end at 2005
  for (const Cell& cell : reduced.cells)
    CHECK(cell.mixed_mm == (std::abs(cell.at.range_mm - 2005) < 0.5 ? 5 : 0));
}

}  // namespace neighbours_test
