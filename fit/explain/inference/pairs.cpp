// SPDX-License-Identifier: MIT
#include "fit/explain/inference/pairs.hpp"

#include <algorithm>
#include <functional>

#include "fit/explain/inference/approximation.hpp"

namespace fit::explain::inference {
namespace {

using Eigen::Index;

/// Mechanisms of sizes alone, with the columns of all of them beside each other.
class Straight {
 public:
  Straight(const Session& session, const Fitted& fitted, const Optimum& around) {
    for (const Kind& kind : session.kinds()) {
      const bool is_straight = !kind.is_form() && kind.starts.size() == 1 && !kind.acts_without_size &&
                               !kind.bins && !kind.threshold && !kind.begins && !kind.coefficients.empty();
      if (!is_straight || std::ranges::any_of(fitted.hypothesis.terms, [&](const Term& term) {
            return term.kind->is_same_cause(kind);
          }))
        continue;
      kinds_.push_back(&kind);
      first_.push_back(count_);
      count_ += std::ssize(kind.coefficients);
    }
    if (kinds_.size() < 2) return;
    std::vector<Eigen::MatrixXd> columns(session.channels().size());
    for (std::size_t c = 0; c < columns.size(); ++c) {
      if (std::ranges::none_of(kinds_, [&](const Kind* kind) { return bool(kind->acts_in[c]); })) continue;
      const ChannelRows& rows = *session.channels()[c];
      columns[c] = Eigen::MatrixXd::Zero(rows.rows(), count_);
      for (std::size_t i = 0; i < kinds_.size(); ++i) {
        const Kind& kind = *kinds_[i];
        if (!kind.acts_in[c]) continue;
        const Eigen::MatrixXd own = model::columns_of(rows, kind, kind.starts.front(), &kind.acts_in[c]);
        columns[c].middleCols(first_[i], own.cols()) = own;
      }
    }
    all_ = projected(fitted, around, whitened_around(session, around, std::move(columns))).front();
  }

  [[nodiscard]] std::size_t size() const { return kinds_.size(); }

  [[nodiscard]] bool is_same_cause(std::size_t one, std::size_t other) const {
    return kinds_[one]->is_same_cause(*kinds_[other]);
  }

  /// Their sizes' factors go together.
  [[nodiscard]] Pair pair(std::size_t one, std::size_t other) const {
    Pair pair;
    std::vector<Index> index;
    for (const std::size_t i : {one, other})
      for (Index k = 0; k < std::ssize(kinds_[i]->coefficients); ++k) index.push_back(first_[i] + k);
    const Quadratic both{all_.square(index, index), all_.along(index)};
    Integral best;
    for (const Factor& f : factors_of(*kinds_[one])) {
      Prior prior = prior_of(*kinds_[one], f.factor);
      prior.append(prior_of(*kinds_[other], f.factor));
      Integral here = integrate(both, prior);
      if (!here.value.allFinite() || here.log_evidence + f.log_weight <= pair.log_evidence) continue;
      pair.log_evidence = here.log_evidence + f.log_weight;
      best = std::move(here);
      for (Term& term : pair.terms) term.factor = f.factor;
    }
    Index first = 0;
    for (const std::size_t i : {one, other}) {
      Term& term = pair.terms[i == one ? 0 : 1];
      const Index count = std::ssize(kinds_[i]->coefficients);
      term.kind = kinds_[i];
      term.values = kinds_[i]->starts.front();
      if (best.value.size() > 0)
        model::set_coefficients(term, best.value.segment(first, count),
                                best.covariance.block(first, first, count, count));
      first += count;
    }
    return pair;
  }

 private:
  std::vector<const Kind*> kinds_;
  std::vector<Index> first_;  ///< Column of every kind.
  Index count_ = 0;
  Quadratic all_;
};

}  // namespace

std::vector<Pair> pairs_beside(const Session& session, const Fitted& fitted, const Optimum& around) {
  const Straight straight(session, fitted, around);
  std::vector<Pair> list;
  for (std::size_t i = 0; i < straight.size(); ++i)
    for (std::size_t j = i + 1; j < straight.size(); ++j)
      if (!straight.is_same_cause(i, j)) list.push_back(straight.pair(i, j));
  std::ranges::sort(list, std::greater<>(), &Pair::log_posterior);
  return list;
}

}  // namespace fit::explain::inference
