// SPDX-License-Identifier: MIT
#include "fit/explain/explanation.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <stdexcept>
#include <utility>

#include "fit/bench/empirical.hpp"
#include "fit/explain/answer/chapters.hpp"
#include "fit/explain/answer/twin.hpp"
#include "fit/explain/around/coarse_steps.hpp"
#include "fit/explain/around/flicker.hpp"
#include "fit/explain/around/vibration.hpp"
#include "fit/explain/inference/explain.hpp"
#include "fit/explain/model/transitions.hpp"
#include "fit/explain/reading.hpp"

namespace fit::explain {
namespace {

/// Targets that are elsewhere, or seen from elsewhere.
std::string on_unmet(const Reduced& reduced) {
  std::vector<std::string> names;
  for (const int target : reduced.unmet) names.push_back("'" + reduced.bench.target_at(target).name + "'");
  return names.size() == 1
             ? "hardly a beam meets target " + names.front() +
                   " where the bench file has it: correct its place, or take it out"
             : "hardly a beam meets targets " + listed(names) +
                   " where the bench file has them: correct their places, or the mount's, or take them out";
}

/// What the model takes as known: the noise, how wide beams are at edges, and coarse steps.
SpreadResult before_the_model(Reduced& reduced) {
  SpreadResult result;
  const auto widths = model::widths_of(model::transitions(reduced));
  if (!widths.empty()) result.noise.footprint_rad = std::sqrt(model::widest_deg2(widths)) * rad_per_deg;
  result.sigma_mm = reduced.typical_sigma_mm();
  if (!reduced.unmet.empty()) result.unknown.push_back({.describes = on_unmet(reduced)});
  find_coarse_steps(reduced, result.sigma_mm, result);
  reduced.vibration_hz = vibration(reduced, result);
  return result;
}

/// What the model finds, and the rooms beside it.
struct Searched {
  Findings findings;
  inference::Inferred inferred;
};

Searched search(Reduced reduced, const Progress& progress) {
  if (progress) progress(unknown_share, "looking at the noise");
  SpreadResult spread = before_the_model(reduced);
  if (progress) progress(unknown_share, "comparing hypotheses");
  inference::Inferred inferred = inference::infer(reduced, spread.noise, progress);
  // A lamp keeps no step with captures: whatever does is known by now.
  if (const auto hz = mains::flicker(reduced, inferred.means.noise, inferred.of_scans, spread)) {
    mains::take_off_flicker(*hz, reduced);
    inferred = inference::infer(reduced, spread.noise, progress);
  }
  return {{std::move(reduced), std::move(spread), inferred.means}, std::move(inferred)};
}

/// The findings in words, chapter by chapter.
Explanation reported(Searched& found) {
  Findings& findings = found.findings;
  Explanation out;
  out.before = findings.means.before;
  out.after = findings.means.after;
  out.noise_floor_mm = findings.means.noise_floor_mm;
  out.samples = findings.reduced.samples;
  out.cells = findings.reduced.cells.size();
  out.left_out = findings.reduced.left_out;
  out.bench = findings.reduced.bench;
  inference::report(found.inferred, findings, out);
  answer::report_spread(findings, out);
  std::ranges::copy(found.inferred.curves, std::back_inserter(out.spread_curves));
  inference::add_to_spread(found.inferred, findings.spread);
  if (!found.inferred.posterior.forms.empty() || !findings.spread.unknown.empty())
    answer::report_unknown(findings, out);
  out.unknown_is_bench_error =
      out.unknown && !findings.reduced.unmet.empty() && out.unknown->describes == on_unmet(findings.reduced);
  answer::report_where(findings, out);
  answer::report_doubts(findings, out);
  answer::doubt_bench_file(findings, out);
  answer::correct_bench(findings, out.bench);
  out.verdict = verdict_of(out);
  return out;
}

}  // namespace

std::string verdict_of(const Explanation& explanation) {
  return explanation.unknown                      ? unknown_physics
         : !explanation.undecided_between.empty() ? "undecided"
         : !explanation.mechanisms.empty()        ? "explained"
                                                  : nothing_missing;
}

Explanation explain(const std::vector<const Recording*>& recordings, const Progress& progress) {
  if (recordings.empty()) throw std::invalid_argument("no recording was given");
  Reading reading(recordings, progress);
  Searched found = search(reading.take_reduced(), progress);
  Findings& findings = found.findings;
  Explanation explanation = reported(found);
  complete_twin(findings.reduced, findings.means, explanation);
  explanation.predictor = predictor_of(findings.reduced, findings.means, findings.spread);
  explanation.several_places = reading.together().in_several_places();
  keep_targets(explanation.bench, reading.together().first_scene());
  explanation.notes.insert(explanation.notes.begin(), reading.notes().begin(), reading.notes().end());
  return explanation;
}

}  // namespace fit::explain
