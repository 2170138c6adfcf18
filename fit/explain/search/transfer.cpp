// SPDX-License-Identifier: MIT
#include "fit/explain/search/transfer.hpp"

#include <algorithm>
#include <optional>
#include <vector>

namespace fit::explain::search {
namespace {

constexpr double confirmed_by = 3;  // log-likelihood of places not fitted to

/// Log-likelihood of every place as all others predict it. A place stands for itself: all that it says
/// together counts, for and against.
std::vector<double> unseen(Fitting& fitting, const Hypothesis& h) {
  const MeanModel model = fitting.placed_model(h);
  std::vector<int> blocks;
  for (Eigen::Index i = 0; i < model.rows(); ++i) blocks.push_back(model.group(i).capture);
  return model.unseen(blocks, static_cast<int>(fitting.reduced().captures.size()));
}

/// What places say for something.
struct Support {
  double gain = 0;
  bool by_most = false;  ///< Most of them are for it.

  [[nodiscard]] bool is_enough() const { return gain > confirmed_by && by_most; }
  /// For an order: what most places are against comes first.
  [[nodiscard]] double score() const { return by_most ? gain : std::min(gain, 0.0) - 1; }
};

Support support_of(const std::vector<double>& with, const std::vector<double>& without) {
  Support support;
  std::size_t confirmed = 0;
  for (std::size_t place = 0; place < with.size(); ++place) {
    support.gain += with[place] - without[place];
    confirmed += with[place] > without[place];
  }
  support.by_most = 2 * confirmed > with.size();
  return support;
}

/// Without what is confirmed least; nothing if all is confirmed enough.
std::optional<Hypothesis> without_least_confirmed(Fitting& fitting, const Hypothesis& h) {
  const std::vector<double> now = unseen(fitting, h);
  std::optional<Hypothesis> better;
  double least = 0;
  for (const Hypothesis& less : fitting.without_each(h)) {
    const Support support = support_of(now, unseen(fitting, less));
    if (support.is_enough() || (better && support.score() > least)) continue;
    least = support.score();
    better = less;
  }
  return better;
}

}  // namespace

bool keep_what_transfers(Fitting& fitting, Hypothesis& best) {
  if (fitting.reduced().captures.size() < 3 || !fitting.reduced().in_several_places()) return true;
  bool all = true;
  while (best.terms.size() + best.shapes.size() > 0) {
    const std::optional<Hypothesis> better = without_least_confirmed(fitting, best);
    if (!better) break;
    best = *better;
    all = false;
  }
  return all;
}

}  // namespace fit::explain::search
