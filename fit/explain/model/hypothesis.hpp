// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/model/unnamed.hpp"

namespace fit::explain {

/// One way to explain the means: where things stand, which mechanisms work, which unnamed functions remain.
struct Hypothesis {
  explicit Hypothesis(const Bench& bench) : nuisance(bench) {}
  Nuisance nuisance;
  std::vector<Active> terms;
  std::vector<Shape> shapes;
};

/// Whether a mechanism moves the means of captures: what differs within one is seen in its scans.
[[nodiscard]] bool moves_means(const Mechanism& mechanism);

/// What the bench knows that may move means, whatever it shows in most.
[[nodiscard]] std::vector<Active> known_terms(const Bench& bench);
/// All that the bench knows to be at work, but its constant noise.
[[nodiscard]] std::vector<Active> known_effects(const Bench& bench);

/// Variance that they add to one sample of the cell, mm^2, beside whole millimetres.
[[nodiscard]] double variance_of_sample(const std::vector<Active>& at_work, const Cell& cell);

/// What a hypothesis holds and what the bench already knows.
[[nodiscard]] std::vector<Active> all_at_work(const Bench& bench, const Hypothesis& hypothesis);

/// Predicts every cell under a hypothesis, with what the bench already knows at work.
void predict_at(Reduced& reduced, const Hypothesis& hypothesis, bool may_leave_out = false);

/// Columns of mount and targets at the present prediction, which has them there.
[[nodiscard]] Columns nuisance_columns(const MeanModel& model, const Nuisance& there);

/// Columns of mount, targets, known and new mechanisms and forms, at the present prediction.
struct Base {
  Columns all;
  std::vector<Eigen::Index> term_first, term_count, shape_first;
};
[[nodiscard]] Base base_columns(const MeanModel& model, const Hypothesis& hypothesis);
/// By how much a mechanism bends away from its formula at every mean, mm; `coefficients` are of all columns.
[[nodiscard]] Eigen::VectorXd bend_of(const Base& base, const Eigen::VectorXd& coefficients,
                                      std::size_t term);

/// The means as a hypothesis leaves them, at the present prediction.
[[nodiscard]] MeanModel model_of(const Reduced& reduced, const MeanNoise& noise,
                                 const Hypothesis& hypothesis);

/// Mount and targets as the means have them under a hypothesis, so often linearised anew; all is predicted
/// there.
void fit_nuisances(Reduced& reduced, const MeanNoise& noise, int passes, Hypothesis& hypothesis);

}  // namespace fit::explain
