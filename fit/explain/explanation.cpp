// SPDX-License-Identifier: MIT
#include "fit/explain/explanation.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>
#include <set>
#include <stdexcept>
#include <utility>

#include "fit/explain/answer/chapters.hpp"
#include "fit/explain/coarse_steps.hpp"
#include "fit/explain/flicker.hpp"
#include "fit/explain/inference/explain.hpp"
#include "fit/explain/model/transitions.hpp"
#include "fit/explain/reduction/dead_beams.hpp"
#include "fit/explain/reduction/misplaced_captures.hpp"
#include "fit/explain/reduction/passers.hpp"
#include "fit/explain/reduction/steady_echoes.hpp"
#include "fit/explain/single_beams.hpp"
#include "fit/explain/together.hpp"
#include "fit/explain/twin.hpp"

namespace fit::explain {
namespace {

/// `passers`: what stood before the targets, in all recordings.
Reduced reduce_all(const Together& together, const std::vector<Passer>& passers, const Progress& progress) {
  const auto& recordings = together.recordings();
  Reduced all;
  for (std::size_t i = 0; i < recordings.size(); ++i) {
    Standing standing = together.standing(i);
    const auto before = static_cast<int>(all.captures.size()),
               here = static_cast<int>(recordings[i]->captures().size());
    for (const Passer& one : passers)
      if (const int capture = one.capture - before; capture >= 0 && capture < here)
        standing.hidden[capture].emplace_back(one.from_rad, one.to_rad);
    const auto tell = [&](double share, const std::string& what) {
      if (progress) progress((static_cast<double>(i) + share) / static_cast<double>(recordings.size()), what);
    };
    Reduced one = reduce(*recordings[i], tell, standing);
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

std::vector<const Recording*> pointers_to(const std::vector<SelectedCaptures>& recordings) {
  std::vector<const Recording*> list;
  for (const SelectedCaptures& one : recordings) list.push_back(&one);
  return list;
}

/// Recordings before one bench, and what they were reduced to.
struct Read {
  std::unique_ptr<Together> together;
  Reduced reduced;
  std::vector<Passer> passers;  ///< What they hid is in no cell.

  Read(const std::vector<const Recording*>& recordings, const Progress& progress)
      : together(std::make_unique<Together>(recordings)), reduced(reduce_all(*together, {}, progress)) {
    refuse_nothing_to_compare(reduced);
    passers = reduced.passers;
    std::ranges::copy(reduction::standing_things(reduced), std::back_inserter(passers));
    if (!passers.empty()) reduced = reduce_all(*together, passers, progress);
  }
};

using Misplaced = std::vector<reduction::MisplacedCapture>;

/// The recordings without captures that were not taken from where they say; indices count through all.
std::vector<SelectedCaptures> without(const Misplaced& misplaced,
                                      const std::vector<SelectedCaptures>& recordings) {
  std::set<std::size_t> indices;
  for (const auto& one : misplaced) indices.insert(static_cast<std::size_t>(one.capture));
  std::vector<SelectedCaptures> list;
  std::size_t before = 0;
  for (const SelectedCaptures& recording : recordings) {
    list.emplace_back(recording, [&](std::size_t i) { return !indices.contains(before + i); });
    before += recording.captures().size();
  }
  return list;
}

std::string note_on(const Misplaced& misplaced, const Reduced& reduced) {
  std::vector<std::string> list;
  for (const auto& [capture, stage_rad, shift_mm] : misplaced) {
    const CaptureInfo& stated = reduced.captures[static_cast<std::size_t>(capture)];
    const std::string which = "capture " + std::to_string(stated.id) + " fits with ";
    list.push_back(stage_rad != stated.stage_rad
                       ? which + "the stage at " + rounded(stage_rad * deg_per_rad, 3) + " deg, not at " +
                             rounded(stated.stage_rad * deg_per_rad, 4)
                       : which + "the target moved by " + rounded(shift_mm, 4) + " mm, not by " +
                             rounded(stated.target_shift_mm, 4));
  }
  if (list.empty()) return {};
  return "What is recorded of where things stood is wrong: " + listed(list) +
         (list.size() == 1 ? ". It was left out; correct it, or record it again."
                           : ". They were left out; correct them, or record them again.");
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

std::string note_on(const std::vector<Passer>& passers, const std::vector<CaptureInfo>& captures) {
  if (passers.empty()) return {};
  std::set<int> in;
  for (const Passer& one : passers) in.insert(one.capture);
  const auto widest =
      std::ranges::max_element(passers, {}, [](const Passer& one) { return one.to_rad - one.from_rad; });
  return "Something stood before the targets in " + std::to_string(in.size()) +
         (in.size() == 1 ? " capture" : " captures") + ": a person, a door. In capture " +
         std::to_string(captures[static_cast<std::size_t>(widest->capture)].id) + " it hid beams between " +
         rounded(widest->from_rad * deg_per_rad, 4) + " and " + rounded(widest->to_rad * deg_per_rad, 4) +
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
  const std::vector<SelectedCaptures> single = single_beams(recordings);
  Read read(pointers_to(single), progress);
  const Misplaced misplaced = reduction::misplaced_captures(read.reduced);
  const std::string note_on_places = note_on(misplaced, read.reduced);
  const std::vector<SelectedCaptures> placed = without(misplaced, single);
  if (!misplaced.empty()) read = Read(pointers_to(placed), progress);
  Reduced& reduced = read.reduced;
  const Together& together = *read.together;
  const std::string note_on_things = note_on(read.passers, reduced.captures);
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
       {note_on_clusters(single), note_on_dead_beams(dead), note_on_things, note_on_places})
    if (!note.empty()) explanation.notes.insert(explanation.notes.begin(), note);
  return explanation;
}

}  // namespace fit::explain
