// SPDX-License-Identifier: MIT
#include "fit/explain/explanation.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <utility>

#include "fit/explain/answer/chapters.hpp"
#include "fit/explain/answer/twin.hpp"
#include "fit/explain/around/around.hpp"
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

/// A setting of firmware or driver, or its largest number.
Unexplained on_limit(const Reduced& reduced) {
  const auto& [mm, share] = *reduced.limit;
  Unexplained u;
  u.coordinate = Coordinate::range;
  u.from = mm;
  for (const Cell& cell : reduced.cells) u.to = std::max({mm, u.to, cell.nominal_mm});
  u.describes = "no range is longer than " + rounded(mm, 6) + " mm, and " + rounded(100 * share, 2) +
                " % of the echoes read exactly that, where targets are as far away or farther: a limit of "
                "firmware or driver. These beams were left out";
  return u;
}

/// How wide beams are at edges; 0: nothing shows it.
double width_at_edges_rad(const Reduced& reduced) {
  const auto widths = model::widths_of(reduced, model::transitions(reduced));
  return widths.empty() ? 0 : std::sqrt(model::widest_deg2(widths)) * rad_per_deg;
}

/// What the model finds, beside what it takes as known: the noise, coarse steps, and what swings.
inference::Inferred search(Reduced& reduced, const Progress& progress) {
  if (progress) progress(unknown_share, "looking at the noise");
  MeanNoise noise;
  noise.footprint_rad = width_at_edges_rad(reduced);
  std::vector<Unexplained> unknown;
  if (!reduced.unmet.empty()) unknown.push_back({.describes = on_unmet(reduced)});
  if (reduced.limit) unknown.push_back(on_limit(reduced));
  const std::optional<Suspect> steps = find_coarse_steps(reduced);
  reduced.vibration_hz = vibration(reduced, unknown);
  if (progress) progress(unknown_share, "comparing hypotheses");
  inference::Inferred inferred = inference::infer(reduced, noise, progress);
  // A lamp keeps no step with captures: whatever does is known by now.
  if (const auto hz = mains::flicker(reduced, inferred.means.noise, inferred.of_scans, unknown)) {
    mains::take_off_flicker(*hz, reduced);
    inferred = inference::infer(reduced, noise, progress);
  }
  if (steps && !reduced.bench.knows(steps->mechanism->id)) {
    inferred.accepted.insert(inferred.accepted.begin(), *steps);
    for (Alternative& alternative : inferred.alternatives) alternative.mechanisms.push_back(*steps);
  }
  inferred.unknown.insert(inferred.unknown.begin(), unknown.begin(), unknown.end());
  return inferred;
}

/// What was found in words, chapter by chapter.
Explanation reported(const Reduced& reduced, const inference::Inferred& inferred) {
  Explanation out;
  out.before = inferred.means.before;
  out.after = inferred.means.after;
  out.noise_floor_mm = inferred.means.noise_floor_mm;
  out.samples = reduced.samples;
  out.cells = reduced.cells.size();
  out.left_out = reduced.left_out;
  out.bench = reduced.bench;
  inference::report(reduced, inferred, out);
  answer::report_coarse_steps(inferred, out);
  out.spread_curves = inferred.curves;
  if (!inferred.posterior.forms.empty() || !inferred.unknown.empty())
    answer::report_unknown(reduced, inferred, out);
  out.unknown_is_bench_error =
      out.unknown && !reduced.unmet.empty() && out.unknown->describes == on_unmet(reduced);
  answer::report_where(reduced, inferred, out);
  answer::report_doubts(reduced, inferred, out);
  answer::doubt_bench_file(reduced, inferred, out);
  answer::correct_bench(inferred, out.bench);
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
  Reduced reduced = reading.take_reduced();
  const inference::Inferred inferred = search(reduced, progress);
  Explanation explanation = reported(reduced, inferred);
  explanation.several_places = reading.together().in_several_places();
  const std::vector<EmpiricalFunction> functions = complete_twin(reduced, inferred.means, explanation);
  if (inferred.means.shapes_carry_over) explanation.correction = functions;
  explanation.predictor =
      predictor_of(reduced, inferred.means, inferred.alternatives, explanation.correction);
  for (const EmpiricalFunction& f : functions) add_empirical(explanation.bench, f);
  keep_targets(explanation.bench, reading.together().first_scene());
  explanation.notes.insert(explanation.notes.begin(), reading.notes().begin(), reading.notes().end());
  return explanation;
}

}  // namespace fit::explain
