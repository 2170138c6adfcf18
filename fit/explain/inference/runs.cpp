// SPDX-License-Identifier: MIT
#include "fit/explain/inference/runs.hpp"

#include <algorithm>

namespace fit::explain {

RunMeans means_over_runs(std::vector<WeighedValue> list, std::size_t each) {
  constexpr double same = 1e-9;
  std::erase_if(list, [](const WeighedValue& v) { return !(v.weight > 0); });
  std::ranges::sort(list, {}, &WeighedValue::at);
  RunMeans means;
  for (std::size_t from = 0; from < list.size();) {
    std::size_t to = std::min(list.size(), from + std::max<std::size_t>(1, each));
    while (to < list.size() && list[to].at <= list[to - 1].at + same) ++to;
    double at = 0, value = 0, weight = 0;
    for (; from < to; ++from) {
      at += list[from].weight * list[from].at;
      value += list[from].weight * list[from].value;
      weight += list[from].weight;
    }
    means.at.push_back(at / weight);
    means.value.push_back(value / weight);
  }
  return means;
}

}  // namespace fit::explain
