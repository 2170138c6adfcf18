// SPDX-License-Identifier: MIT
#pragma once

#include <limits>
#include <memory>
#include <vector>

#include "fit/explain/inference/session.hpp"

namespace fit::explain::inference {

/// The columns of a hypothesis in every channel, each scaled by the standard deviation of its coefficient's
/// prior, so that priors are standard normal around `mean`.
struct Design {
  struct Part {
    Eigen::MatrixXd columns;
    std::vector<Eigen::Index> index;  ///< Of each column's coefficient.
    Eigen::VectorXd offset;           ///< Of the predictor where all coefficients are zero.
    std::shared_ptr<const Squared> fixed;  ///< Of the columns, where the information is the same anywhere.

    /// Adds what coefficients do, of these from one on and before another; by its columns, or whitened ones.
    void add(const Eigen::MatrixXd& by, const Eigen::VectorXd& x, Eigen::VectorXd& sum,
             Eigen::Index first = 0, Eigen::Index last = std::numeric_limits<Eigen::Index>::max()) const;
  };
  struct Block {
    Eigen::Index first = 0, sizes = 0, shapes = 0, deviations = 0;
    Eigen::Index of_formula = 0;  ///< Of the deviations, so many of the first.
    [[nodiscard]] Eigen::Index first_shape() const { return first + sizes; }
    [[nodiscard]] Eigen::Index first_deviation() const { return first_shape() + shapes; }
    [[nodiscard]] Eigen::Index end() const { return first_deviation() + deviations; }
  };
  std::vector<Part> parts;  ///< By channel.
  Eigen::VectorXd mean, sigma;
  Eigen::VectorXd lower, upper;  ///< Bounds of the coefficients: signs of sizes, ends of shapes.
  std::vector<Block> blocks;     ///< By term.
};
[[nodiscard]] Design design_of(const Session& session, const std::vector<Term>& terms);
/// Whether a coefficient acts where the information depends on where it is taken: on counts, variances,
/// widths.
[[nodiscard]] bool acts_unevenly(const Session& session, const Design& design, Eigen::Index coefficient);
/// Shapes as if they were known: of that information, and of no other coefficient's.
void hold_shapes(const Design& design, double known, Eigen::MatrixXd& information);

/// The most probable coefficients of a design (in units of `sigma`), and the likelihood around them.
struct Optimum {
  Eigen::VectorXd x;
  std::vector<Eigen::VectorXd> eta;
  std::vector<Eigen::MatrixXd> white;  ///< Columns of every channel, whitened there.
  std::vector<Eigen::VectorXd> white_residual;
  /// Gradient of each channel's log-likelihood by its columns' coefficients, where the information is fixed.
  std::vector<Eigen::VectorXd> along;
  std::vector<Eigen::VectorXd>
      root;  ///< Of the information of independent rows; only if expanded for new terms.
  Eigen::LLT<Eigen::MatrixXd> factor;  ///< Of the information with the priors'.
  double log_likelihood = 0, log_posterior = -1e300;
  std::vector<double> of_channel;  ///< The parts of the log-likelihood.
};
[[nodiscard]] Optimum optimum_of(const Session& session, const Design& design, const Eigen::VectorXd& start);

/// The likelihood's curvature there for `factor`; returns where a scoring step of all coefficients leads, the
/// shapes' with them.
Eigen::VectorXd curvature_at(const Session& session, const Design& design, Optimum& there);

/// The same likelihood, linearised where terms that are still missing may take it.
[[nodiscard]] Optimum expanded_for_new_terms(const Session& session, const Design& design,
                                             const Optimum& optimum);

}  // namespace fit::explain::inference
