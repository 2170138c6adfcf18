// SPDX-License-Identifier: MIT
#include "fit/explain/model/spans.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <vector>

namespace spans_test {

using fit::explain::model::RowScore;
using fit::explain::model::Span;

TEST_CASE("what may have changed up to a moment may have changed from it on") {
  // A target's place is a nuisance, which lies between where it was before and where it was after.
  std::vector<RowScore> rows;
  for (int capture = 0; capture < 16; ++capture)
    rows.push_back({10.0 * capture, capture < 8 ? -1.3 : 1.0, 1});
  const auto spans = fit::explain::model::spans_in(rows, true).likeliest;
  REQUIRE(!spans.empty());
  CHECK(spans.front() == Span{-10, 75});
  CHECK(std::ranges::count(spans, Span{75, 160}) == 1);
}

}  // namespace spans_test
