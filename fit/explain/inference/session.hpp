// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "fit/explain/model/term.hpp"
#include "fit/numeric/products.hpp"

/// Inference in the model of docs/method/model.md.
namespace fit::explain::inference {

using model::ChannelRows;
using model::Kind;
using model::Term;

/// One way to explain a session: what is missing, and how well that explains it.
struct Hypothesis {
  std::vector<Term> terms;
  Eigen::VectorXd base;  ///< Nuisances of all channels, one after the other.
  double log_evidence = -1e300, log_prior = 0;
  double log_fit = -1e300;  ///< Log-likelihood, with what the bench file says of the nuisances.

  [[nodiscard]] double log_posterior() const { return log_evidence + log_prior; }
  [[nodiscard]] bool has(const Kind& kind) const;
  [[nodiscard]] std::vector<const Kind*> kinds() const;
  /// Its other terms, with nothing known of the nuisances.
  [[nodiscard]] Hypothesis less(const std::function<bool(const Term&)>& these) const;
};

/// What coefficients with these standard deviations are counted in: none is zero.
[[nodiscard]] inline Eigen::VectorXd units_of(const Eigen::VectorXd& sigma) { return sigma.cwiseMax(1e-12); }

/// Whitened columns with their products.
struct Squared {
  Eigen::MatrixXd white, square;
};
[[nodiscard]] inline Squared squared(Eigen::MatrixXd white) {
  Eigen::MatrixXd square = square_of_columns(white);
  return {std::move(white), std::move(square)};
}

/// A session as rows of all channels, its means linearised where a hypothesis predicts.
class Session {
 public:
  /// First linearised there.
  Session(Reduced& reduced, MeanNoise noise, const Nuisance& there);

  /// Predicts there; all hypotheses that are compared must be fitted after the same call, where their combs
  /// follow.
  void linearise(Hypothesis& at, std::vector<Hypothesis>& following);

  [[nodiscard]] const Reduced& reduced() const { return reduced_; }
  /// Of the means, at the present linearisation.
  [[nodiscard]] const MeanNoise& noise() const { return present_noise_; }
  /// Of a channel's base, in units of its prior's standard deviations; null where the information is not
  /// fixed.
  [[nodiscard]] const std::shared_ptr<const Squared>& white_base(std::size_t channel) const {
    return white_base_[channel];
  }
  /// In the order of model::channel_kinds(); null where the session has no rows.
  [[nodiscard]] const std::vector<std::unique_ptr<ChannelRows>>& channels() const { return channels_; }
  /// Of a channel's predictor where all coefficients are zero.
  [[nodiscard]] const Eigen::VectorXd& offset(std::size_t channel) const { return offsets_[channel]; }
  [[nodiscard]] const std::vector<Kind>& kinds() const { return *kinds_; }
  /// Terms point to these.
  [[nodiscard]] std::shared_ptr<const std::vector<Kind>> shared_kinds() const { return kinds_; }
  /// What a kind does at one of its starts in one channel.
  struct AtStart {
    /// Per coefficient, as the first linearisation with these rows had them; whitened, as the first one with
    /// this noise had them, where the information is fixed.
    Eigen::MatrixXf columns;
    Eigen::VectorXf without_size;  ///< Whatever its sizes are; empty where that is nothing.
    /// Where the information is fixed: the columns' products, and those with the base's.
    Eigen::MatrixXd square, with_base;
  };
  /// By channel; one kind must not be asked for by two threads at once.
  [[nodiscard]] const std::vector<AtStart>& at_start(const Kind& kind, std::size_t start) const;
  /// Mount and targets as the coefficients have them.
  [[nodiscard]] Nuisance nuisance(const Hypothesis& h) const;
  /// First of a channel's base coefficients among those of all.
  [[nodiscard]] Eigen::Index first_base(std::size_t channel) const;
  [[nodiscard]] Eigen::Index count_base() const { return first_base(channels_.size()); }

 private:
  void make_channels(const MeanNoise& noise);
  /// Forgets of a channel's starts what does not hold any more.
  void keep_starts(std::size_t channel, bool same_rows, bool same_noise);
  [[nodiscard]] double mean_range_mm() const;
  [[nodiscard]] std::vector<Active> means_at_work(const Hypothesis& h) const;
  /// Where bins lie is known against what is recorded: they follow when mount and targets make all ranges
  /// longer or shorter, on average.
  void keep_combs(Hypothesis& at, std::vector<Hypothesis>& following);

  Reduced& reduced_;
  std::vector<Active> known_;        ///< What the bench knows to be at work.
  MeanNoise noise_, present_noise_;  ///< As given, and with what the hypothesis says of scans.
  std::vector<std::unique_ptr<ChannelRows>> channels_;
  std::vector<Eigen::VectorXd> offsets_;
  std::vector<std::shared_ptr<const Squared>> white_base_;
  std::shared_ptr<const std::vector<Kind>> kinds_;
  mutable std::vector<std::vector<std::vector<AtStart>>> at_starts_;  ///< By kind, start and channel.
};

}  // namespace fit::explain::inference
