// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Dense>
#include <vector>

#include "fit/explain/model/mean_model.hpp"
#include "fit/explain/model/term.hpp"

namespace fit::explain::inference {

/// A likelihood near its maximum, all other coefficients integrated: exp(along.x - x.square.x / 2).
struct Quadratic {
  Eigen::MatrixXd square;
  Eigen::VectorXd along;
};

struct Integral {
  double log_evidence = 0;  ///< Against all coefficients zero.
  Eigen::VectorXd value;
  Eigen::MatrixXd covariance;
};

/// Integrates it over independent normal priors.
[[nodiscard]] Integral integrate(const Quadratic& likelihood, const Prior& prior);

/// A factor that prior sizes may have, with the log of its probability.
struct Factor {
  double factor = 1, log_weight = 0;
};
/// Those of a kind: one alone where a size is expected to be something.
[[nodiscard]] std::vector<Factor> factors_of(const model::Kind& kind);
/// The prior of a kind's coefficients at a factor.
[[nodiscard]] Prior prior_of(const model::Kind& kind, double factor);
/// Log of what signs and largest sizes leave of the posterior, over what they leave of the prior.
[[nodiscard]] double log_possible(const model::Kind& kind, const Eigen::VectorXd& value,
                                  const Eigen::MatrixXd& covariance);

struct OverFactors {
  Integral best;
  double factor = 1;
  double log_evidence = -1e300;  ///< Integrated over the factor.
};
/// Factors between two, of which a likelihood is known well enough, and the log evidence that none exceeds.
struct FactorRange {
  double least = 0, most = 1e300, highest = 1e300;
};
/// The first coefficients are those of the kind, any others have standard normal priors.
[[nodiscard]] OverFactors integrate_over_factors(const Quadratic& likelihood, const model::Kind& kind,
                                                 const FactorRange& range = {});

/// Of the matrix that was factored.
[[nodiscard]] double log_determinant(const Eigen::LLT<Eigen::MatrixXd>& factor);
[[nodiscard]] double log_sum(const std::vector<double>& logs);

}  // namespace fit::explain::inference
