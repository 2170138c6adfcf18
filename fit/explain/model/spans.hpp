// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <vector>

namespace fit::explain::model {

/// What the log-likelihood says of one row's effect: its slope where there is none, and its information.
struct RowScore {
  double place = 0, score = 0, information = 0;
};

/// Leaves the largest few of a list by that measure, the largest first.
template <class Item, class Measure>
void keep_best(std::size_t most, std::vector<Item>& list, Measure measure) {
  const std::size_t count = std::min(most, list.size());
  std::ranges::partial_sort(list, list.begin() + static_cast<std::ptrdiff_t>(count), std::greater<>(),
                            measure);
  list.resize(count);
}

/// From one place of a coordinate to another.
struct Span {
  double from = 0, to = 0;
  bool operator==(const Span&) const = default;
};

/// Spans between which an effect may be limited.
struct Spans {
  std::vector<Span> likeliest;  ///< The best first.
  std::size_t possible = 0;     ///< All that there are.
};

/// Spans that begin and end between recorded places (of more than so many, between groups of neighbours) and
/// leave some of them out, the likeliest few by the score test of an effect within the span and none outside.
[[nodiscard]] Spans spans_in(std::vector<RowScore> rows, bool either_sign, std::size_t most_places = 60);

/// Between recorded places, where they are farthest apart, that many at most; not before the first nor behind
/// the last.
[[nodiscard]] std::vector<double> places_between(std::vector<double> places, std::size_t most);

/// Places between recorded ones below which, and above which not, an effect may be: the likeliest few by the
/// same test.
[[nodiscard]] std::vector<double> thresholds_in(std::vector<RowScore> rows);

}  // namespace fit::explain::model
