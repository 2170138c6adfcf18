// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

namespace fit::explain {

/// Cuts sorted places (`place_of(0)`, ... `place_of(count - 1)`) into runs of `each`, longer where the
/// cut would part places that are the same: the first of each, and one past its last.
template <typename PlaceOf>
[[nodiscard]] std::vector<std::pair<std::size_t, std::size_t>> runs_of(std::size_t count, std::size_t each,
                                                                       const PlaceOf& place_of) {
  std::vector<std::pair<std::size_t, std::size_t>> list;
  for (std::size_t from = 0; from < count;) {
    std::size_t to = std::min(count, from + each);
    while (to < count && place_of(to) <= place_of(to - 1) + 1e-9) ++to;
    list.emplace_back(from, to);
    from = to;
  }
  return list;
}

}  // namespace fit::explain
