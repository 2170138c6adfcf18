// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Dense>
#include <vector>

#include "fit/explain/mean_model.hpp"

namespace fit::explain::intensity {

/// Columns with independent normal priors around zero.
struct Block {
  Eigen::MatrixXd columns;
  Eigen::VectorXd sigma;  ///< Of every column's coefficient.

  void add(const Eigen::MatrixXd& more, double sigma_of_more);
  void add(const Block& more);
};

/// Linear model of the deviations of the logarithm of intensity from the claim, row by row; its base
/// (nuisances, what is accepted) is marginalised as in MeanModel.
class Model {
 public:
  /// `weight`: one over the standard uncertainty of every deviation.
  Model(const Eigen::VectorXd& deviations, Eigen::VectorXd weight, const Block& base);

  [[nodiscard]] Eigen::VectorXd coefficients() const;   ///< Of the base's columns.
  [[nodiscard]] Eigen::VectorXd uncertainties() const;  ///< Of these, standard.
  /// What is left of the deviations when the base has taken up what it can.
  [[nodiscard]] Eigen::VectorXd residual() const { return rest_.cwiseQuotient(weight_); }
  /// What is left of an effect when the base has taken up what it can, in standard uncertainties.
  [[nodiscard]] Eigen::VectorXd left_of(const Eigen::VectorXd& effect) const;
  /// For MeanModel::solve.
  [[nodiscard]] MeanModel::Products products(const Eigen::MatrixXd& columns) const;
  /// Gain of the log-likelihood by an effect of this very size.
  [[nodiscard]] double gain(const Eigen::VectorXd& effect) const;
  [[nodiscard]] const Eigen::VectorXd& weight() const { return weight_; }

  struct HeldOut {
    double log_likelihood = 0;
    double rms = 0;  ///< Of what the prediction leaves; relative intensity.
  };
  /// Predicts every part (0 .. parts - 1, one number a row) from all others.
  [[nodiscard]] HeldOut held_out(const std::vector<int>& part_of_row, int parts) const;

 private:
  Eigen::VectorXd weight_, white_;  ///< white_: deviations in standard uncertainties.
  Eigen::MatrixXd base_;            ///< In standard uncertainties, scaled by the priors' sigmas.
  Eigen::VectorXd sigma_, along_, rest_;
  Eigen::LLT<Eigen::MatrixXd> factor_;
};

}  // namespace fit::explain::intensity
