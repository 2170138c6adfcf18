// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "fit/bench/empirical.hpp"
#include "fit/explain/model/results.hpp"

namespace fit::explain {

/// Constant noise of a sample. Every capture draws its variance log-normally about this one, as those that
/// were seen differ by more than their samples explain: a random effect of captures.
struct ConstantNoise {
  double mm = 0;          ///< The middle one.
  double log_spread = 0;  ///< Standard deviation of a new capture's log of the variance.
};

/// What a set of recordings taught, in a form that predicts another one.
struct Predictor {
  /// One of the hypotheses that count. What happened once is predicted of no other recording.
  struct Description {
    double probability = 1;
    std::vector<KnownMechanism> mechanisms;
    ConstantNoise constant;  ///< Beside them.
  };
  std::vector<Description> descriptions;     ///< The most probable first; together certain.
  std::vector<EmpiricalFunction> functions;  ///< Without a name, of the best one.
  ConstantNoise constant_before;             ///< With geometry and what the bench knew alone.
};

/// Mean and noise of samples that were never fitted, under one description.
struct PredictedFigures {
  double rms_mm = 0;           ///< Of single samples.
  double rms_of_means_mm = 0;  ///< Of the cells' means.
  double log_likelihood = 0;   ///< Of one sample, on average; natural logarithm, density per mm.
  double coverage_95 = 0;      ///< Share of samples within their predicted 95 % interval.
};

struct PredictedCell {
  double incidence_deg = 0, range_mm = 0, beam_deg = 0;
  double mean_mm = 0, sd_mm = 0;  ///< Residual mean (after mount and walls were placed, before) and spread.
  double mean_after_mm = 0, sd_before_mm = 0, sd_after_mm = 0;
};

/// A recording that took no part in the fit, predicted with geometry and constant noise (before) and with
/// what was found (after): by all hypotheses that count, each with its probability (Bayesian model averaging,
/// Hoeting et al. 1999). What is drawn anew for it is fitted to it, in both alike: where its own targets and
/// mount stand, and how much constant noise its captures have, as captures were seen to differ. What is
/// uncertain of the hypotheses widens intervals, and the likelihood is integrated over it.
struct Prediction {
  std::string session;
  long samples = 0;
  std::size_t cells = 0;
  PredictedFigures before, after;
  double gain = 0, u_gain = 0;  ///< Log-likelihood, whole recording; its standard uncertainty between cells.
  std::vector<PredictedCell> shown;
  std::vector<std::string>
      notes;  ///< What of the recording was left out, and why: sentences for the operator.
};

/// `reduced` is left predicted by one of them.
[[nodiscard]] Predictor predictor_of(Reduced& reduced, const MeanResult& means,
                                     const std::vector<Alternative>& alternatives,
                                     const std::vector<EmpiricalFunction>& functions);
[[nodiscard]] Prediction predict_recording(const Predictor& predictor, const Recording& recording);

}  // namespace fit::explain
