// SPDX-License-Identifier: MIT
#include "fit/explain/explanation.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>
#include <stdexcept>
#include <utility>

#include "fit/explain/answer/chapters.hpp"
#include "fit/explain/coarse_steps.hpp"
#include "fit/explain/flicker.hpp"
#include "fit/explain/inference/explain.hpp"
#include "fit/explain/model/transitions.hpp"
#include "fit/explain/reduction/dead_beams.hpp"
#include "fit/explain/reduction/steady_echoes.hpp"
#include "fit/explain/single_beams.hpp"
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
        [&](double share, const std::string& what) {
          if (progress)
            progress((static_cast<double>(i) + share) / static_cast<double>(recordings.size()), what);
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

std::string note_on_dead_beams(const reduction::Sectors& dead) {
  if (dead.empty()) return {};
  std::vector<std::string> sectors;
  for (const auto& [from, to] : dead)
    sectors.push_back(from == to ? rounded(from * deg_per_rad, 5) + " deg"
                                 : "from " + rounded(from * deg_per_rad, 5) + " to " +
                                       rounded(to * deg_per_rad, 5) + " deg");
  return "Beams at " + listed(sectors) +
         " return nothing in any capture, while those beside them see the same surface. They were left out: "
         "they are dead, or something stands before the window.";
}

std::string note_on_passers(const Reduced& reduced) {
  if (reduced.passers.empty()) return {};
  std::set<int> captures;
  for (const Passer& one : reduced.passers)
    captures.insert(reduced.groups[static_cast<std::size_t>(one.group)].capture);
  const auto most = std::ranges::max_element(reduced.passers, {}, &Passer::scans);
  const Group& group = reduced.groups[static_cast<std::size_t>(most->group)];
  return "Something stood before the targets in some scans of " + std::to_string(captures.size()) +
         (captures.size() == 1 ? " capture" : " captures") + ": a person, a door. In capture " +
         std::to_string(group.capture + 1) + " it was in " + std::to_string(most->scans) + " of " +
         std::to_string(group.scans) + " scans, between the beams at " +
         rounded(most->from_rad * deg_per_rad, 4) + " and " + rounded(most->to_rad * deg_per_rad, 4) +
         " deg. What it hid was left out.";
}

/// What the model takes as known: the noise, how wide beams are at edges, and coarse steps.
SpreadResult before_the_model(Reduced& reduced) {
  SpreadResult result;
  const auto widths = model::widths_of(model::transitions(reduced));
  if (!widths.empty()) result.noise.footprint_rad = std::sqrt(model::widest_deg2(widths)) * rad_per_deg;
  result.sigma_mm = reduced.typical_sigma_mm();
  find_coarse_steps(reduced, result.sigma_mm, result);
  return result;
}

/// What the model finds, and the rooms beside it.
struct Searched {
  Findings findings;
  inference::Inferred inferred;
};

Searched search(Reduced reduced, const Progress& progress) {
  SpreadResult spread = before_the_model(reduced);
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
  const std::vector<SingleBeams> single = single_beams(recordings);
  std::vector<const Recording*> looked_at;
  for (const SingleBeams& one : single) looked_at.push_back(&one);
  const Together together(looked_at);
  Reduced reduced = reduce_all(together, progress);
  refuse_nothing_to_compare(reduced);
  const reduction::Sectors dead = reduction::leave_out_dead_beams(reduced);
  reduction::steady_echoes(reduced);
  Searched found = search(std::move(reduced), progress);
  Findings& findings = found.findings;
  Explanation explanation = reported(found);
  complete_twin(findings.reduced, findings.means, explanation);
  explanation.predictor = predictor_of(findings.reduced, findings.means, findings.spread);
  explanation.several_places = together.in_several_places();
  explanation.bench.targets.resize(together.first_scene());
  explanation.notes.insert(explanation.notes.begin(), together.notes().begin(), together.notes().end());
  for (const std::string& note :
       {note_on_clusters(single), note_on_dead_beams(dead), note_on_passers(findings.reduced)})
    if (!note.empty()) explanation.notes.insert(explanation.notes.begin(), note);
  return explanation;
}

}  // namespace fit::explain
