// SPDX-License-Identifier: MIT
#include "fit/explain/inference/one_model.hpp"

#include <algorithm>
#include <optional>
#include <utility>

#include "fit/explain/answer/answering.hpp"
#include "fit/explain/answer/chapters.hpp"
#include "fit/explain/coarse_steps.hpp"
#include "fit/explain/inference/explain.hpp"
#include "fit/explain/spread/flicker.hpp"
#include "fit/explain/spread/regular_patterns.hpp"

namespace fit::explain {
namespace inference {
namespace {

/// Whether the model has rows for what a suspect does.
bool has_rows(const Suspect& suspect) {
  if (!suspect.mechanism) return false;
  const Observable shows_in = suspect.mechanism->observable;
  if (shows_in == Observable::range_mean) return false;  // of whole scans, which have no rows yet
  std::vector<double> typical;
  for (const Parameter& p : suspect.mechanism->parameters) typical.push_back(p.typical);
  if (shows_in == Observable::range_distribution) return suspect.mechanism->act(Circumstances{}, typical).stray > 0;
  return std::ranges::any_of(model::channel_kinds(), [&](const auto& kind) { return kind.observable == shows_in; });
}

/// What other rooms say of whole scans, memory, edges and steps, without what the model has rows for.
void leave_to_the_model(SpreadResult& spread) {
  std::erase_if(spread.accepted, has_rows);
  spread.brought_along.clear();
  std::erase_if(spread.undecided, [](const auto& set) { return std::ranges::any_of(set, has_rows); });
  std::erase_if(spread.unknown, [](const Unexplained& u) {
    return u.observable == Observable::range_variance || u.observable == Observable::dropout;
  });
}

/// What one model finds, and the other rooms beside it.
struct ByOneModel {
  Findings findings;
  Inferred inferred;
};

ByOneModel search_by_one_model(Reduced reduced, const Progress& progress) {
  SpreadResult spread = explain_spread(reduced);
  add_bias_of_coarse_steps(spread, reduced);
  if (spread::flickers(spread)) spread::take_off_flicker(reduced);
  spread::take_off_patterns(spread, reduced);
  leave_to_the_model(spread);
  Inferred inferred = infer(reduced, spread.noise, progress);
  std::optional<StrayLight> light = stray_light(reduced, inferred.means);
  if (light && !light->or_mixed_pixel) {
    take_off(*light, reduced);
    inferred = infer(reduced, spread.noise, progress);
  }
  MeanResult means = inferred.means;
  return {{std::move(reduced), std::move(spread), std::move(means), std::move(light)}, std::move(inferred)};
}

Explanation told_by_one_model(ByOneModel& found) {
  Findings& findings = found.findings;
  Explanation out;
  out.before = findings.means.before;
  out.after = findings.means.after;
  out.noise_floor_mm = findings.means.noise_floor_mm;
  out.samples = findings.reduced.samples;
  out.cells = findings.reduced.cells.size();
  out.left_out = findings.reduced.left_out;
  out.bench = findings.reduced.bench;
  tell(found.inferred, findings, out);
  answer::tell_stray_light(findings, out);
  answer::tell_spread(findings, out);
  add_to_spread(found.inferred, findings.spread);
  if (!found.inferred.posterior.forms.empty() || !findings.spread.unknown.empty()) answer::tell_unknown(findings, out);
  answer::tell_where(findings, out);
  answer::tell_doubts(findings, out);
  answer::doubt_bench_file(findings, out);
  answer::correct_bench(findings, out.bench);
  out.verdict = verdict_of(out);
  return out;
}

}  // namespace
}  // namespace inference

Explanation explain_by_one_model(const std::vector<const Recording*>& recordings, const Progress& progress) {
  return explain_with(recordings, progress, [&](Reduced reduced) {
    inference::ByOneModel found = inference::search_by_one_model(std::move(reduced), progress);
    Explanation explanation = inference::told_by_one_model(found);
    return std::pair(std::move(found.findings), std::move(explanation));
  });
}

}  // namespace fit::explain
