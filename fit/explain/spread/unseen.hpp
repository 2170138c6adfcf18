// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <vector>

namespace fit::explain::spread {

/// Deals captures out to that many blocks, one of which at a time a suspect is not fitted to.
[[nodiscard]] inline std::map<int, int> block_of_capture(const std::set<int>& captures, int blocks) {
  std::map<int, int> block;
  for (const int capture : captures) {
    const int next = static_cast<int>(block.size()) % blocks;
    block.emplace(capture, next);
  }
  return block;
}

/// How many blocks these are.
[[nodiscard]] inline int blocks_in(const std::map<int, int>& block_of_capture) {
  int blocks = 0;
  for (const auto& [capture, block] : block_of_capture) blocks = std::max(blocks, block + 1);
  return blocks;
}

/// What a suspect gains in captures that it was not fitted to: the sum of `gain(own, others)` of the items of
/// every block of captures, four at most, and all other items. Not known with fewer than two captures.
template <class Item, class Gain, class CaptureOf = int Item::*>
[[nodiscard]] std::optional<double> held_out_gain(const std::vector<Item>& items, const Gain& gain,
                                                  CaptureOf capture_of) {
  std::set<int> captures;
  for (const Item& item : items) captures.insert(std::invoke(capture_of, item));
  if (captures.size() < 2) return {};
  const int blocks = static_cast<int>(std::min<std::size_t>(4, captures.size()));
  const std::map<int, int> block = block_of_capture(captures, blocks);
  double sum = 0;
  for (int b = 0; b < blocks; ++b) {
    std::vector<Item> own, others;
    for (const Item& item : items)
      (block.at(std::invoke(capture_of, item)) == b ? own : others).push_back(item);
    sum += gain(own, others);
  }
  return sum;
}

/// What blocks say of a suspect that was fitted to the others only.
class Unseen {
 public:
  /// `change` of the log-likelihood of one block.
  void add(double change) {
    gain_ += change;
    if (std::abs(change) < 0.5) return;  // has no say
    (change > 0 ? confirmed_ : denied_) += 1;
  }
  /// All together; none, unless two confirm it and fewer deny it.
  [[nodiscard]] double gain() const {
    return confirmed_ > 1 && confirmed_ > denied_ ? gain_ : std::min(gain_, -1.0);
  }

 private:
  double gain_ = 0;
  int confirmed_ = 0, denied_ = 0;
};

}  // namespace fit::explain::spread
