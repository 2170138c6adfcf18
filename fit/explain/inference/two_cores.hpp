// SPDX-License-Identifier: MIT
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <future>

namespace fit::explain::inference {

/// Does both, at the same time. What either throws is the caller's, as if there were one thread.
template <typename One, typename Other>
void at_the_same_time(const One& one, const Other& other) {
  auto second = std::async(std::launch::async, std::cref(other));
  one();
  second.get();
}

/// Does `work(i)` for every i < count, on whichever core is free: what takes longest should come first.
template <typename Work>
void on_two_cores(std::size_t count, const Work& work) {
  std::atomic<std::size_t> next{0};
  const auto run = [&] {
    for (std::size_t i = next++; i < count; i = next++) work(i);
  };
  at_the_same_time(run, run);
}

}  // namespace fit::explain::inference
