// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "fit/explain/reduction/left_out.hpp"
#include "fit/explain/reduction/margins.hpp"
#include "fit/numeric/median.hpp"

namespace fit::explain::reduction {
namespace {

constexpr std::size_t fewest_through = 4;  // beams side by side
constexpr std::size_t at_ends = 2;         // beams that meet it in part
constexpr double other_beams_rad = 3 * rad_per_deg;
constexpr double same_place = 0.5;  // share of what both cover

bool goes_through(const Cell& cell) {
  return cell.n > 0 ? cell.mean_mm > cell.nominal_mm + off_target_mm : cell.lost > 0 && cell.stray == 0;
}
bool is_near(const Cell& cell) { return std::abs(cell.off_mm()) < off_target_mm; }
bool is_met(const Cell& cell) { return cell.n > 0 && cell.lost == 0 && is_near(cell); }

/// How far a mean is off, in units of what it is off for sure.
double off_for_sure(const Reduced& reduced, const Cell& cell) {
  constexpr double least_mm = 40, sigmas = 12;
  const double noise_mm = std::max(least_mm, sigmas * reduced.group_of(cell).sigma_mm / std::sqrt(cell.n));
  return std::abs(cell.off_mm()) / (noise_mm + coverage_of_mount * misplaced_mm(reduced.bench, cell.sight));
}
bool is_elsewhere(const Reduced& reduced, const Cell& cell) {
  return cell.n > 0 ? off_for_sure(reduced, cell) > 1 : goes_through(cell);
}
bool is_there(const Reduced& reduced, const Cell& cell) {
  return cell.n > 0 && cell.lost == 0 && off_for_sure(reduced, cell) < 0.5;
}
/// Whether it may belong to what is elsewhere beside it.
bool leans(const Reduced& reduced, const Cell& cell) {
  return cell.n > 0 && off_for_sure(reduced, cell) > 0.25;
}

bool is_hidden(const Cell& cell) { return cell.n + cell.lost + cell.stray == 0; }

/// Neighbours of one group that do not meet their target where it is, though it goes on on both sides.
struct Run {
  int target = 0, capture = 0;
  double from_mm = 0, to_mm = 0, beam_rad = 0;
  double each_mm = 0;  ///< From one beam to the next.

  /// At one place of the target, seen by other beams.
  [[nodiscard]] bool is_same_place(const Run& other) const {
    const double both = std::min(to_mm, other.to_mm) - std::max(from_mm, other.from_mm),
                 either = std::max(to_mm, other.to_mm) - std::min(from_mm, other.from_mm);
    return target == other.target && both > same_place * either &&
           std::abs(beam_rad - other.beam_rad) > other_beams_rad;
  }
};

/// From one end of a run on: the last cell that leans towards it or would, if it goes on to lean as they do;
/// not beyond so many.
long where_it_begins(const Group& group, std::size_t run_end, long step, long no_more,
                     const Reduced& reduced) {
  const auto cell = [&](long i) -> const Cell& { return reduced.cells[static_cast<std::size_t>(i)]; };
  const auto strong = static_cast<long>(run_end);
  const auto goes_on = [&](long i) {
    return i >= static_cast<long>(group.first_cell) && i < static_cast<long>(group.last_cell) &&
           cell(i).at.target == cell(strong).at.target;
  };
  long last = strong;
  while (goes_on(last + step) && leans(reduced, cell(last + step))) last += step;
  const double there = std::abs(cell(last).off_mm()), falls = std::abs(cell(strong).off_mm()) - there;
  if (last == strong || falls <= 0) return last;
  const double more = there / falls * static_cast<double>(std::abs(last - strong));
  for (long k = 0; k < std::min(no_more, std::lround(std::ceil(more))) && goes_on(last + step); ++k)
    last += step;
  return last;
}

/// The beams beside one end of a run.
struct EndOfRun {
  bool goes_on = false, is_there = false, is_hidden = false;
};

/// Whether most of what is seen of a target is where it should be: else something else is the matter.
bool is_mostly_there(const Reduced& reduced, const Group& group, int target) {
  int seen = 0, there = 0;
  for (const Cell& cell : reduced.cells_of(group)) {
    if (cell.at.target != target || is_hidden(cell)) continue;
    ++seen;
    there += is_there(reduced, cell);
  }
  return 2 * there > seen;
}

void add_runs(const Reduced& reduced, const Group& group, std::vector<Run>& runs) {
  if (is_turning(reduced.capture_of(group))) return;  // its cells are of several beams of one scan
  const auto& cells = reduced.cells;
  for (std::size_t first = group.first_cell, end = first; first < group.last_cell;
       first = std::max(end, first + 1)) {
    end = first;
    while (end < group.last_cell && is_elsewhere(reduced, cells[end]) &&
           cells[end].at.target == cells[first].at.target)
      ++end;
    if (end - first < fewest_through) continue;
    const int target = cells[first].at.target;
    // Before and behind beams that meet an end of it in part: what bends away is nowhere there at once. What
    // hides the target there has been found, or is another one.
    const auto beside = [&](std::size_t from, long step) {
      EndOfRun seen;
      for (std::size_t k = 0, i = from; k <= at_ends && i >= group.first_cell && i < group.last_cell;
           ++k, i = static_cast<std::size_t>(static_cast<long>(i) + step)) {
        const bool is_own = cells[i].at.target == target;
        seen.is_hidden |=
            is_own ? is_hidden(cells[i]) : cells[i].nominal_mm + off_target_mm < cells[first].nominal_mm;
        seen.goes_on |= is_own && !is_elsewhere(reduced, cells[i]);
        seen.is_there |= is_own && is_there(reduced, cells[i]);
      }
      return seen;
    };
    const EndOfRun before = first > group.first_cell ? beside(first - 1, -1) : EndOfRun();
    const EndOfRun behind = beside(end, 1);
    if (!(before.goes_on || before.is_hidden) || !(behind.goes_on || behind.is_hidden)) continue;
    const bool ends_at_once = before.is_there || behind.is_there || before.is_hidden || behind.is_hidden;
    if (!ends_at_once || !(before.goes_on || behind.goes_on)) continue;
    if (!is_mostly_there(reduced, group, target)) continue;
    const auto from_end = [&](const EndOfRun& seen, std::size_t run_end, long step) {
      if (seen.is_there) return run_end;
      return static_cast<std::size_t>(
          where_it_begins(group, run_end, step, static_cast<long>(end - first), reduced));
    };
    const std::size_t from = from_end(before, first, -1), to = from_end(behind, end - 1, 1) + 1;
    Run run{target, group.capture, cells[from].at.along_mm, cells[to - 1].at.along_mm,
            (cells[from].beam_rad + cells[to - 1].beam_rad) / 2};
    if (run.from_mm > run.to_mm) std::swap(run.from_mm, run.to_mm);
    run.each_mm = (run.to_mm - run.from_mm) / static_cast<double>(to - 1 - from);
    runs.push_back(run);
  }
}

/// One more run, where another may have shown the same opening.
void add_to(const Run& run, std::vector<Opening>& openings) {
  for (Opening& one : openings) {
    if (one.target != run.target || run.from_mm > one.to_mm || run.to_mm < one.from_mm) continue;
    one.from_mm = std::min(one.from_mm, run.from_mm);
    one.to_mm = std::max(one.to_mm, run.to_mm);
    return;
  }
  openings.push_back({run.target, run.from_mm, run.to_mm});
}

/// In captures that show it, with beams that meet its ends in part; in all others as far as it is seen there:
/// where the field of view ends within it, or not at all.
void leave_out(Opening& one, double margin_mm, Reduced& reduced) {
  std::vector<double> off_mm;
  std::set<int> captures;
  for (const Group& group : reduced.groups) {
    std::vector<Cell*> within;
    bool is_shown = false;
    for (Cell& cell : reduced.cells_of(group)) {
      if (cell.at.target != one.target || cell.at.along_mm < one.from_mm - margin_mm ||
          cell.at.along_mm > one.to_mm + margin_mm)
        continue;
      within.push_back(&cell);
      if (!is_elsewhere(reduced, cell)) continue;
      is_shown = true;
      off_mm.push_back(goes_through(cell) ? off_target_mm : cell.off_mm());
    }
    if (is_shown) captures.insert(group.capture);
    for (Cell* cell : within)
      if (is_shown || leans(reduced, *cell)) cell->leave_out();
  }
  one.captures = static_cast<int>(captures.size());
  one.off_mm = median_of(std::move(off_mm));
}

}  // namespace

std::vector<Opening> leave_out_openings(Reduced& reduced) {
  std::vector<Run> runs;
  for (const Group& group : reduced.groups) add_runs(reduced, group, runs);
  std::vector<Opening> openings;
  double margin_mm = 0;
  for (const Run& run : runs) {
    if (std::ranges::none_of(runs, [&](const Run& other) { return run.is_same_place(other); })) continue;
    add_to(run, openings);
    margin_mm = std::max(margin_mm, static_cast<double>(at_ends) * run.each_mm);
  }
  for (Opening& one : openings) leave_out(one, margin_mm, reduced);
  return openings;
}

std::map<int, int> leave_out_absent_targets(Reduced& reduced) {
  struct Beams {
    std::size_t all = 0, met = 0, behind = 0;
  };
  const auto shift_mm = [&](int capture) {
    return reduced.captures[static_cast<std::size_t>(capture)].target_shift_mm;
  };
  std::map<std::pair<int, double>, std::map<int, Beams>> seen;  // of every target and its place, by capture
  for (const Cell& cell : reduced.cells) {
    const int capture = reduced.group_of(cell).capture;
    Beams& beams = seen[{cell.at.target, shift_mm(capture)}][capture];
    ++beams.all;
    beams.met += is_met(cell);
    beams.behind += goes_through(cell);
  }
  std::set<std::pair<int, int>> absent;  // target and capture
  for (const auto& [place, captures] : seen) {
    if (std::ranges::none_of(captures, [](const auto& one) { return 2 * one.second.met > one.second.all; }))
      continue;  // it is nowhere
    for (const auto& [capture, beams] : captures)
      if (beams.behind >= fewest_through && beams.behind + 2 * at_ends >= beams.all && beams.met == 0)
        absent.insert({place.first, capture});
  }
  for (Cell& cell : reduced.cells)
    if (absent.contains({cell.at.target, reduced.group_of(cell).capture})) cell.leave_out();
  std::map<int, int> captures;
  for (const auto& [target, capture] : absent) ++captures[target];
  return captures;
}

void leave_out_unmet_targets(Reduced& reduced) {
  constexpr int fewest = 20, few = 20;  // beams; a twentieth
  struct Beams {
    int near = 0, elsewhere = 0;
  };
  std::map<int, Beams> of_target;
  for (const Cell& cell : reduced.cells) {
    if (is_hidden(cell)) continue;
    Beams& beams = of_target[cell.at.target];
    ++(cell.n > 0 && is_near(cell) ? beams.near : beams.elsewhere);
  }
  for (const auto& [target, beams] : of_target)
    if (beams.elsewhere >= fewest && few * beams.near < beams.near + beams.elsewhere)
      reduced.unmet.push_back(target);
  for (Cell& cell : reduced.cells)
    if (std::ranges::count(reduced.unmet, cell.at.target)) cell.leave_out();
}

}  // namespace fit::explain::reduction
