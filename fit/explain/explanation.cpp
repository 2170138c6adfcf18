// SPDX-License-Identifier: MIT
#include "fit/explain/explanation.hpp"

#include <stdexcept>
#include <utility>

#include "fit/explain/answer/answering.hpp"
#include "fit/explain/answer/chapters.hpp"
#include "fit/explain/coarse_steps.hpp"
#include "fit/explain/intensity.hpp"
#include "fit/explain/reduction/steady_echoes.hpp"
#include "fit/explain/single_beams.hpp"
#include "fit/explain/spread/flicker.hpp"
#include "fit/explain/spread/regular_patterns.hpp"
#include "fit/explain/together.hpp"
#include "fit/explain/twin.hpp"

namespace fit::explain {
namespace {

Reduced reduce_all(const Together& together, const Progress& progress) {
  const auto& recordings = together.recordings();
  Reduced all;
  for (std::size_t i = 0; i < recordings.size(); ++i) {
    Reduced one = reduce(
        *recordings[i],
        [&](double share, const char* what) {
          if (progress)
            progress(0.3 * (static_cast<double>(i) + share) / static_cast<double>(recordings.size()), what);
        },
        together.standing(i));
    if (i == 0)
      all = std::move(one);
    else
      append(all, one);
  }
  return all;
}

void refuse_nothing_to_compare(const Reduced& reduced) {
  if (reduced.bench.targets.empty())
    throw std::invalid_argument(
        "the bench has no targets, so there is nothing to compare the recording with. Describe the walls or "
        "boards "
        "under 'targets' and give the bench with --bench");
  if (reduced.cells.empty())
    throw std::invalid_argument(
        "no beam of the recording meets a target of the bench. Check the targets' places and the frames of "
        "the scans");
}

/// Spread first, the means weighed by it, and stray light, after which both are searched again.
Findings search(Reduced reduced, const Progress& progress) {
  const auto searched = [&](double share, const char* what) {
    if (progress) progress(0.35 + 0.63 * share, what);
  };
  SpreadResult spread = explain_spread(reduced);
  add_bias_of_coarse_steps(spread, reduced);
  if (spread::flickers(spread)) spread::take_off_flicker(reduced);
  spread::take_off_patterns(spread, reduced);
  MeanResult means = search_means(reduced, spread.noise, searched);
  std::optional<StrayLight> light = stray_light(reduced, means);
  if (light && !light->or_mixed_pixel) {
    take_off(*light, reduced);
    spread = explain_spread(reduced);
    means = search_means(reduced, spread.noise, searched);
  }
  return {std::move(reduced), std::move(spread), std::move(means), std::move(light)};
}

/// The findings in words, chapter by chapter.
Explanation told(Findings& findings) {
  Explanation out;
  out.before = findings.means.before;
  out.after = findings.means.after;
  out.noise_floor_mm = findings.means.noise_floor_mm;
  out.samples = findings.reduced.samples;
  out.cells = findings.reduced.cells.size();
  out.left_out = findings.reduced.left_out;
  out.bench = findings.reduced.bench;
  answer::tell_means(findings, out);
  answer::tell_stray_light(findings, out);
  answer::tell_spread(findings, out);
  answer::tell_unknown(findings, out);
  answer::tell_stated_otherwise(findings, out);
  answer::tell_where(findings, out);
  answer::tell_doubts(findings, out);
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

Explanation explain_with(const std::vector<const Recording*>& recordings, const Progress& progress,
                         const Answer& answer) {
  if (recordings.empty()) throw std::invalid_argument("no recording was given");
  const std::vector<SingleBeams> single = single_beams(recordings);
  std::vector<const Recording*> looked_at;
  for (const SingleBeams& one : single) looked_at.push_back(&one);
  const Together together(looked_at);
  Reduced reduced = reduce_all(together, progress);
  refuse_nothing_to_compare(reduced);
  std::vector<double> own_echoes = reduction::steady_echoes(reduced);
  auto [findings, explanation] = answer(std::move(reduced));
  reduction::exchange_echoes(findings.reduced, own_echoes);
  explain_intensity(findings.reduced, explanation);
  reduction::exchange_echoes(findings.reduced, own_echoes);
  complete_twin(findings.reduced, findings.means, explanation);
  explanation.predictor = predictor_of(findings.reduced, findings.means, findings.spread);
  explanation.several_places = together.in_several_places();
  explanation.bench.targets.resize(together.first_scene());
  explanation.notes.insert(explanation.notes.begin(), together.notes().begin(), together.notes().end());
  if (const std::string note = note_on_clusters(single); !note.empty())
    explanation.notes.insert(explanation.notes.begin(), note);
  if (progress) progress(1, "done");
  return std::move(explanation);
}

Explanation explain(const std::vector<const Recording*>& recordings, const Progress& progress) {
  return explain_with(recordings, progress, [&](Reduced reduced) {
    Findings findings = search(std::move(reduced), progress);
    Explanation explanation = told(findings);
    return std::pair(std::move(findings), std::move(explanation));
  });
}

}  // namespace fit::explain
