// SPDX-License-Identifier: MIT
#pragma once

#include "fit/bench/empirical.hpp"
#include "fit/explain/explanation.hpp"
#include "fit/explain/inference/posterior.hpp"
#include "fit/explain/model/results.hpp"

namespace fit::explain::inference {

/// Of the log-likelihood of the rows, by one term.
struct Gain {
  double held_out = 0;  ///< In captures that took no part in the fit.
  double fitted = 0;    ///< In those that did: none where only priors ask for it.
};

/// What the model of docs/method/model.md finds in a session.
struct Inferred {
  std::shared_ptr<const std::vector<Kind>> kinds;  ///< Which terms point to.
  Posterior posterior;
  MeanResult means;  ///< The best hypothesis' part in the means, with the held-out figures of all channels.
  double sigma_mm = 0;                   ///< Constant noise of one sample.
  std::vector<SpreadCurve> curves = {};  ///< Of what is beside the means, where something was found.
  std::vector<Suspect> accepted = {};    ///< What acts on something other than means and is confirmed.
  std::vector<Alternative> alternatives = {};  ///< The most probable first; together certain.
  std::vector<Unexplained> unknown = {};  ///< Contradictions, forms beside the means, and noise that is none.
  std::vector<Active> of_scans = {};     ///< What the best hypothesis says of scans of a capture.
  std::vector<Gain> gain = {};           ///< Of every named one.
  std::vector<std::string> notes = {};   ///< Of channels, on how well they agree.
  struct Restated {
    std::size_t channel;
    std::vector<Estimate> nuisances;
  };
  std::vector<Restated> restated = {};         ///< What the bench file states and a channel knows better.
  std::vector<EmpiricalFunction> tables = {};  ///< For the twin: what has no name beside the means.
};

/// A form with what it came out as.
[[nodiscard]] Shape as_shape(const Term& term);

/// `noise`: of the means. The cells of `reduced` are left predicted at the best hypothesis.
[[nodiscard]] Inferred infer(Reduced& reduced, const MeanNoise& noise, const Progress& progress);

/// Lists what is accepted beside the means and what predicts other recordings, and adds what is contradicted
/// to the unknown.
void list_beside_means(Inferred& inferred);

/// Tells it: mechanisms and undecided sets.
void report(const Reduced& reduced, const Inferred& inferred, Explanation& out);

}  // namespace fit::explain::inference
