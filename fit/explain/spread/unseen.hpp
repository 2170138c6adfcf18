// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

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
