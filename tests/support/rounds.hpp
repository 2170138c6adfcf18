// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <vector>

/// Rounds of a test with one seed each: a tenth of them in the suite, all where RIG_ALL_ROUNDS is set
/// (scripts/test --long). Tests with such rounds have the tag [rounds].
inline unsigned rounds(unsigned all) { return std::getenv("RIG_ALL_ROUNDS") ? all : (all + 9) / 10; }

/// Cases of a test: the first in the suite; all of them with all rounds.
template <class Case>
std::vector<Case> some_of(const std::vector<Case>& all) {
  return std::getenv("RIG_ALL_ROUNDS") ? all : std::vector<Case>{all.front()};
}

/// Of so many tries that succeed with that probability, fewer succeed once in a hundred times.
inline int least_successes(int tries, double probability) {
  double of_so_many = std::pow(1 - probability, tries), sum = 0;  // binomial
  for (int k = 0; k <= tries; ++k) {
    sum += of_so_many;
    if (sum > 0.01) return k;
    of_so_many *= probability / (1 - probability) * (tries - k) / (k + 1);
  }
  return tries;
}
