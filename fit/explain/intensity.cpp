// SPDX-License-Identifier: MIT
#include "fit/explain/intensity.hpp"

#include "fit/explain/intensity/answer.hpp"
#include "fit/explain/intensity/judgement.hpp"
#include "fit/explain/intensity/places.hpp"
#include "fit/explain/intensity/readings.hpp"
#include "fit/explain/intensity/rivals.hpp"
#include "fit/explain/intensity/search.hpp"

namespace fit::explain {

void explain_intensity(const Reduced& reduced, Explanation& explanation) {
  const std::optional<IntensityClaim> claim = claimed_intensity(reduced.bench);
  if (!claim || !reduced.has_intensity) return;
  std::optional<intensity::Readings> readings = intensity::readings_of(reduced, *claim);
  if (!readings) {
    explanation.notes.push_back(
        "The bench claims a law of intensity, but the recording has too little intensity to test it.");
    return;
  }
  intensity::weigh(*readings);
  const intensity::Judgement judgement = intensity::judge(*readings, intensity::search(*readings));
  const intensity::FittedLaw fitted = intensity::fitted_law(*readings, judgement.accepted);
  intensity::tell_findings(*readings, judgement, fitted, explanation);
  intensity::add_tables(*readings, judgement, explanation.bench);
  state_intensity(explanation.bench, fitted.law, fitted.u, intensity::sample_noise(*readings));
  explanation.intensity_curves = intensity::curves_of(*readings, fitted.model);
  intensity::add_notes(*readings, judgement, explanation);
  explanation.verdict = verdict_of(explanation);
}

Eigen::MatrixXd evidence_between(const Reduced& reduced, const std::vector<LightSuspect>& suspects) {
  const std::optional<IntensityClaim> claim = claimed_intensity(reduced.bench);
  if (claim && reduced.has_intensity)
    if (const auto readings = intensity::readings_of(reduced, *claim))
      return intensity::evidence_between(*readings, suspects);
  const auto size = static_cast<Eigen::Index>(suspects.size());
  return Eigen::MatrixXd::Zero(size, size);
}

}  // namespace fit::explain
