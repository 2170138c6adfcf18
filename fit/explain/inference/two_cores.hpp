// SPDX-License-Identifier: MIT
#pragma once

#include <atomic>
#include <cstddef>
#include <future>

namespace fit::explain::inference {

/// Does `work(i)` for every i < count, on whichever core is free: what takes longest should come first.
/// What either core throws is the caller's, as if there were one.
template <typename Work>
void on_two_cores(std::size_t count, const Work& work) {
  std::atomic<std::size_t> next{0};
  const auto run = [&] {
    for (std::size_t i = next++; i < count; i = next++) work(i);
  };
  auto second = std::async(std::launch::async, run);
  run();
  second.get();
}

}  // namespace fit::explain::inference
