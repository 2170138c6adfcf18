// SPDX-License-Identifier: MIT
#include "fit/explain/reading.hpp"

#include <algorithm>
#include <iterator>
#include <set>
#include <stdexcept>
#include <utility>

#include "fit/explain/explanation.hpp"
#include "fit/explain/reduction/expected_echo.hpp"
#include "fit/explain/reduction/left_out.hpp"
#include "fit/explain/reduction/occluders.hpp"
#include "fit/explain/reduction/range_limit.hpp"
#include "fit/explain/reduction/steady_echoes.hpp"

namespace fit::explain {
namespace {

/// `occluders`: what stood before the targets, in all recordings.
Reduced reduce_all(const Together& together, const std::vector<Occluder>& occluders, const Progress& progress,
                   bool keep_samples) {
  const auto& recordings = together.recordings();
  Reduced all;
  for (std::size_t i = 0; i < recordings.size(); ++i) {
    Standing standing = together.standing(i);
    for (const Occluder& one : occluders) standing.hidden[one.capture].emplace_back(one.from_rad, one.to_rad);
    const auto report = [&](double share, const std::string& what) {
      if (progress) progress((static_cast<double>(i) + share) / static_cast<double>(recordings.size()), what);
    };
    reduce_into(all, *recordings[i], report, standing, keep_samples);
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

/// Captures for which the stage says another angle than it was sent to: one of the two is wrong.
std::string note_on_readback(const std::vector<CaptureInfo>& captures) {
  constexpr double far_rad = 0.2 * rad_per_deg;  // play and windup are physics, and smaller
  const auto is_elsewhere = [](const CaptureInfo& c) {
    return c.stage_readback_rad && !is_turning(c) &&
           std::abs(wrap_angle(*c.stage_readback_rad - c.stage_rad)) > far_rad;
  };
  const auto first = std::ranges::find_if(captures, is_elsewhere);
  if (first == captures.end()) return {};
  const auto count = std::count_if(first, captures.end(), is_elsewhere);
  return "The stage says elsewhere in " + std::to_string(count) +
         (count == 1 ? " capture: capture " : " captures: capture ") + std::to_string(first->id) +
         " was sent to " + rounded(first->stage_rad * deg_per_rad, 5) + " deg and says " +
         rounded(*first->stage_readback_rad * deg_per_rad, 5) + " deg" + (count == 1 ? "." : ", and so on.") +
         " Angles as sent were used. Look at the stage's readback, or at what it is homed to.";
}

std::string beams_at(const reduction::Sectors& list) {
  std::vector<std::string> sectors;
  for (const auto& [from, to] : list)
    sectors.push_back(from == to ? rounded(from * deg_per_rad, 5) + " deg"
                                 : "from " + rounded(from * deg_per_rad, 5) + " to " +
                                       rounded(to * deg_per_rad, 5) + " deg");
  return "Beams at " + listed(sectors);
}

std::string note_on_dead_beams(const reduction::Sectors& dead) {
  if (dead.empty()) return {};
  return beams_at(dead) +
         " return nothing in any capture, while those beside them see the same surface. They were left out: "
         "they are dead, or something stands before the window.";
}

std::string note_on_odd_beams(const reduction::Sectors& odd) {
  if (odd.empty()) return {};
  return beams_at(odd) +
         " read far otherwise than those beside them on the same surface, capture after capture. They were "
         "left out.";
}

std::string note_on_scans(const Reduced& reduced) {
  std::string text;
  if (reduced.repeated > 0)
    text = "Scans came more than once, the same to the last millimetre: " + std::to_string(reduced.repeated) +
           " beside " + std::to_string(reduced.scans) + ". Each counts once. ";
  if (reduced.broken > 0)
    text += rounded(100.0 * reduced.broken / reduced.scans, 2) +
            " % of the scans have gaps: nothing came back from many beams side by side, where others have "
            "echoes. These parts were left out. ";
  if (!text.empty()) text += "Look at the driver, the network and the load of the computer.";
  return text;
}

std::string note_on(const std::vector<reduction::Opening>& openings, const Bench& bench) {
  std::vector<std::string> through, standing;
  for (const auto& [target, from_mm, to_mm, captures, off_mm] : openings) {
    const std::string where = "target '" + bench.target_at(target).name + "' from " + rounded(from_mm, 4) +
                              " to " + rounded(to_mm, 4) + " mm from its middle in " +
                              std::to_string(captures) + " captures";
    if (off_mm >= off_target_mm)
      through.push_back(where);
    else
      standing.push_back(rounded(std::abs(off_mm), 2) + " mm " + (off_mm < 0 ? "before " : "behind ") +
                         where);
  }
  std::string text;
  if (!through.empty())
    text = "Beams go through " + listed(through) +
           ": nothing comes back, or what stands far behind. That was left out. It is an opening, glass or "
           "something dark, which the bench file does not have: add it there, or close it and record again.";
  if (!standing.empty())
    text += (text.empty() ? "Something stands " : " Something stands ") + listed(standing) +
            ". That was left out: the bench file does not have it. Add it there, or take it away and record "
            "again.";
  return text;
}

std::string note_on(const std::map<int, int>& absent, const Bench& bench) {
  std::vector<std::string> list;
  for (const auto& [target, captures] : absent)
    list.push_back("target '" + bench.target_at(target).name + "' in " + std::to_string(captures) +
                   (captures == 1 ? " capture" : " captures"));
  if (list.empty()) return {};
  return "Beams find nothing, or what stands far behind, instead of " + listed(list) +
         ": it was not there. What they met was left out. Put it back and record these again.";
}

/// Where the thing stood that most captures saw at one place, and in how many.
std::pair<Eigen::Vector2d, std::size_t> usual_place(const std::vector<Occluder>& occluders) {
  constexpr double one_place_mm = 250;
  std::pair<Eigen::Vector2d, std::size_t> usual;
  for (const Occluder& one : occluders) {
    std::set<int> in;
    for (const Occluder& other : occluders)
      if (one.at_mm && other.at_mm && (*one.at_mm - *other.at_mm).norm() < one_place_mm)
        in.insert(other.capture);
    if (in.size() > usual.second) usual = {*one.at_mm, in.size()};
  }
  return usual;
}

/// `one_bench`: all captures are of one recording, with one frame.
std::string note_on(const std::vector<Occluder>& occluders, const std::vector<CaptureInfo>& captures,
                    bool one_bench) {
  if (occluders.empty()) return {};
  std::set<int> in;
  for (const Occluder& one : occluders) in.insert(one.capture);
  const auto widest =
      std::ranges::max_element(occluders, {}, [](const Occluder& one) { return one.to_rad - one.from_rad; });
  constexpr std::size_t stays = 3;  // captures: who walks by stands at one place in fewer
  const auto [place, times] = usual_place(occluders);
  const std::string what =
      times < stays || !one_bench
          ? ": a person, a door."
          : ", in " + std::to_string(times) + " of them at about x = " + rounded(place.x(), 3) +
                " mm, y = " + rounded(place.y(), 3) +
                " mm. Add it to the bench file, correct the target that it is, or take it away.";
  return "Something stood before the targets in " + std::to_string(in.size()) +
         (in.size() == 1 ? " capture" : " captures") + what + " In capture " +
         std::to_string(captures[static_cast<std::size_t>(widest->capture)].id) + " it hid beams between " +
         rounded(widest->from_rad * deg_per_rad, 4) + " and " + rounded(widest->to_rad * deg_per_rad, 4) +
         " deg. What it hid was left out.";
}

}  // namespace

std::vector<Occluder> Reading::read(const Progress& progress) {
  together_ = std::make_unique<Together>(pointers_to(kept_));
  reduced_ = reduce_all(*together_, {}, progress, keep_samples_);
  refuse_nothing_to_compare(reduced_);
  std::vector<Occluder> hidden;
  const auto read_again = [&] {
    const std::optional<RangeLimit> limit = reduced_.limit;
    reduced_ = {};  // both would be too much memory
    reduced_ = reduce_all(*together_, hidden, progress, keep_samples_);
    reduced_.limit = limit;
  };
  reduced_.limit = reduction::range_limit(reduced_);
  if (reduced_.limit) {
    hidden = reduction::beyond(reduced_, *reduced_.limit);
    read_again();
  }
  std::vector<Occluder> occluders = reduced_.occluders;
  std::ranges::copy(reduction::standing_occluders(reduced_), std::back_inserter(occluders));
  if (occluders.empty()) return occluders;
  std::ranges::copy(occluders, std::back_inserter(hidden));
  read_again();
  return occluders;
}

Reading::Reading(const std::vector<const Recording*>& recordings, const Progress& progress, bool keep_samples)
    : single_(single_beams(recordings)), kept_(without({}, single_)), keep_samples_(keep_samples) {
  std::vector<Occluder> occluders = read(progress);
  const Misplaced misplaced = reduction::misplaced_captures(reduced_, together_->recordings());
  const std::string note_on_places = note_on(misplaced, reduced_),
                    on_readback = note_on_readback(reduced_.captures);
  if (!misplaced.empty()) {
    kept_ = without(misplaced, single_);
    occluders = read(progress);
  }
  const std::string note_on_things = note_on(occluders, reduced_.captures, recordings.size() == 1);
  const reduction::Sectors dead = reduction::leave_out_dead_beams(reduced_);
  const reduction::Sectors odd = reduction::leave_out_odd_beams(reduced_);
  const std::string note_on_openings = note_on(reduction::leave_out_openings(reduced_), reduced_.bench);
  reduction::leave_out_unmet_targets(reduced_);
  reduction::steady_echoes(reduced_);
  reduction::expect_beyond_end_of_counts(reduced_);
  const std::string note_on_absent = note_on(reduction::leave_out_absent_targets(reduced_), reduced_.bench);
  for (const std::string& note :
       {note_on_places, on_readback, note_on_things, note_on_dead_beams(dead), note_on_odd_beams(odd),
        note_on_openings, note_on_absent, note_on_scans(reduced_), note_on_clusters(single_)})
    if (!note.empty()) notes_.push_back(note);
  notes_.insert(notes_.end(), together_->notes().begin(), together_->notes().end());
}

}  // namespace fit::explain
