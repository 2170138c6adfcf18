// SPDX-License-Identifier: MIT
#include "fit/explain/inference/runs.hpp"

#include <catch2/catch.hpp>

namespace runs_test {

using Catch::Detail::Approx;
using fit::explain::means_over_runs;

TEST_CASE("runs of neighbours are averaged by weight, part no place, and reach to the last") {
  const auto means =
      means_over_runs({{3, 30, 1}, {1, 10, 1}, {2, 20, 3}, {3, 50, 1}, {4, 7, 1}, {5, 9, 0}}, 2);
  REQUIRE(means.at.size() == 3);
  CHECK(means.at[0] == Approx(1.75));
  CHECK(means.value[0] == Approx(17.5));
  CHECK(means.at[1] == Approx(3));
  CHECK(means.value[1] == Approx(40));
  CHECK(means.at[2] == Approx(4));
  CHECK(means.value[2] == Approx(7));
  CHECK(means_over_runs({}, 3).at.empty());
  CHECK(means_over_runs({{1, 2}, {1, 4}, {2, 8}}, 0).value.size() == 2);
}

}  // namespace runs_test
