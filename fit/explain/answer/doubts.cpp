// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "fit/explain/answer/chapters.hpp"
#include "fit/explain/reduction/expected_echo.hpp"
#include "fit/numeric/angle.hpp"

namespace fit::explain::answer {
namespace {

std::string on_off_targets(const Reduced& reduced) {
  return "Most of what was recorded (" + std::to_string(reduced.off_targets) + " of " +
         std::to_string(reduced.in_clear) + " cells away from edges) lies more than " +
         rounded(off_target_mm) +
         " mm off the bench file's targets: is it the "
         "bench file of this set-up? Check places, mount and the stage's zero before anything "
         "here is believed.";
}

std::string on_another_scene(const MeanResult& means) {
  return "Without functions that nobody stated, what is recorded lies " +
         rounded(means.without_functions.rms_mm, 3) +
         " mm (rms) off the bench file: more than a lidar errs by. Is it the bench file of this set-up? "
         "Check places, mount and the stage's zero; nothing is named before.";
}

std::string on_left_out(const Reduced& reduced) {
  return std::to_string(reduced.left_out) + " of " + std::to_string(reduced.cells.size()) +
         " cells were left out of the means: edges, grazing incidence, doubtful walls.";
}

std::string on_excess(double excess) {
  return "The means of neighbouring beams scatter " + rounded(std::sqrt(excess), 3) +
         " times more than their samples say; everything was weighed accordingly.";
}

bool is_anything_found(const Explanation& out) {
  return !out.mechanisms.empty() || !out.undecided_between.empty() || out.unknown;
}

/// Held-out figures that contradict "nothing is missing": the other stops are too few to learn from them
/// where the lidar and the targets stand.
bool placed_by_bench_alone(const MeanResult& means, const Explanation& out) {
  return !is_anything_found(out) && means.after.coverage < 0.5 &&
         means.after.rms_mm > 3 * means.noise_floor_mm;
}

std::string on_worse_held_out(const Explanation& out) {
  return "Captures that took no part in the fit lie farther off with what was found than without: " +
         rounded(out.after.rms_mm) + " mm instead of " + rounded(out.before.rms_mm) +
         " mm. Captures contradict each other. Look for one whose target, distance or stage angle is not "
         "what its description says.";
}

/// Something came or went in one of several recordings that each count their time from the same beginning.
bool is_dated(const Explanation& out) {
  return std::ranges::any_of(out.mechanisms, [](const Found& found) {
    return found.mechanism->happened_once(found.mechanism->values(found.parameters));
  });
}

std::string on_clock(const std::vector<double>& later_s) {
  std::vector<std::string> list;
  for (std::size_t i = 0; i < later_s.size(); ++i)
    if (later_s[i] != 0)
      list.push_back(rounded(later_s[i], 3) + " s to the times of recording " + std::to_string(i + 1));
  return "Recordings that count their time from the same beginning are taken one after the other. "
         "This adds " +
         listed(list) + ", wherever it is said when something came or went.";
}

constexpr const char* on_few_stops =
    "The held-out figures say only how well the bench file knows where lidar and targets stand: the stops "
    "are too few to learn it from some and predict the others. What they have in common cannot be told "
    "from that. Record more stage angles before relying on this.";

/// Whether beam angles scatter as much as angles do that are rounded to the beams' spacing.
bool is_rounding(const Estimate& sigma_deg, double grid_deg) {
  return std::abs(sigma_deg.value - grid_deg / std::sqrt(12.0)) <= 2 * sigma_deg.u + 0.02 * sigma_deg.value;
}

std::string on_rounded_angles(double grid_deg) {
  return "Beam angles scatter by as much as angles do that are rounded to the beams' spacing: " +
         rounded(grid_deg, 3) + " deg / sqrt(12) = " + rounded(grid_deg / std::sqrt(12.0), 3) + " deg.";
}

std::string on_end_of_counts(const reduction::EndOfCounts& end) {
  return "Counts end at " + rounded(end.counts, 4) + ": " + std::to_string(end.cells) +
         " cells show as many, though their echoes differ by a factor of " +
         rounded(end.strongest / end.weakest, 2) +
         " by distance, incidence and reflectance. The receiver clips there, and these echoes were taken "
         "as that makes them. Put a grey filter over what is bright to see them.";
}

}  // namespace

void report_doubts(const Reduced& reduced, const Inferred& inferred, Explanation& out) {
  const MeanResult& means = inferred.means;
  const auto note = [&](std::string text) { out.notes.push_back(std::move(text)); };
  if (2 * reduced.off_targets > reduced.in_clear) note(on_off_targets(reduced));
  if (means.is_another_scene()) note(on_another_scene(means));
  if (reduced.left_out > 0) note(on_left_out(reduced));
  if (placed_by_bench_alone(means, out)) note(on_few_stops);
  if (means.is_worse_held_out()) note(on_worse_held_out(out));
  if (means.excess > 1) note(on_excess(means.excess));
  if (is_dated(out) && std::ranges::any_of(reduced.later_s, [](double s) { return s != 0; }))
    note(on_clock(reduced.later_s));
  if (const reduction::EndOfCounts end(reduced); is_anything_found(out) && end.is_reached())
    note(on_end_of_counts(end));
  const double grid_deg = reduced.bench.lidar.step_rad * deg_per_rad;
  for (const Suspect& suspect : inferred.accepted)
    if (suspect.mechanism->id == "angle-jitter" && is_rounding(suspect.parameters.at("sigma_deg"), grid_deg))
      note(on_rounded_angles(grid_deg));
}

}  // namespace fit::explain::answer
