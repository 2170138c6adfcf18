// SPDX-License-Identifier: MIT
#include "fit/explain/spread/regular_patterns.hpp"

#include <algorithm>
#include <vector>

#include "fit/explain/spread/suspects.hpp"

namespace fit::explain::spread {

void take_off(double mean_mm, double variance_mm2, Cell& cell) {
  constexpr double least_left = 0.1;
  cell.mean_mm -= mean_mm;
  if (cell.n > 1)
    cell.variance_mm2 =
        std::max(least_left * cell.variance_mm2, cell.variance_mm2 - variance_mm2 * cell.n / (cell.n - 1.0));
}

namespace {

/// When every scan of a group was taken, seconds after its first.
std::vector<std::vector<double>> times_of_scans(const Reduced& reduced) {
  std::vector<std::vector<double>> times_s(reduced.groups.size());
  std::vector<const Sector*> first(reduced.groups.size());
  for (const Sector& s : reduced.sectors) {
    const auto group = static_cast<std::size_t>(s.group);
    if (!first[group]) first[group] = &s;
    if (s.number == first[group]->number)
      times_s[group].push_back(s.since_move_s - first[group]->since_move_s);
  }
  return times_s;
}

void take_off_swing(const Suspect& swing, Reduced& reduced) {
  std::vector<double> values;
  for (const Parameter& p : swing.mechanism->parameters) values.push_back(swing.parameters.at(p.name).value);
  const std::vector<std::vector<double>> times_s = times_of_scans(reduced);
  for (Cell& cell : reduced.cells) {
    const std::vector<double>& of_group = times_s[static_cast<std::size_t>(cell.group)];
    if (of_group.empty() || cell.n < 1) continue;
    double sum = 0, squares = 0;
    for (const double after_first_s : of_group) {
      Circumstances then = cell.at;
      then.since_move_s += after_first_s;
      const double off_mm = cell.sight.stage_lever() * swing.mechanism->act(then, values).stage_rad;
      sum += off_mm;
      squares += off_mm * off_mm;
    }
    const auto scans = static_cast<double>(of_group.size());
    take_off(sum / scans, squares / scans - sum / scans * sum / scans, cell);
  }
}

}  // namespace

void take_off_patterns(const SpreadResult& found, Reduced& reduced) {
  if (reduced.is_without_patterns) return;
  reduced.is_without_patterns = !found.faces.empty() || is_accepted(found, ids::settling);
  for (const Suspect& s : found.accepted)
    if (is(s, ids::settling)) take_off_swing(s, reduced);
  for (Cell& cell : reduced.cells) {
    const auto group = static_cast<std::size_t>(cell.group);
    if (group < found.faces.size())
      take_off(found.faces[group].mean_mm, found.faces[group].variance_mm2, cell);
  }
}

void distrust_beside_patterns(SpreadResult& result) {
  constexpr double unseen_strays = 1e-3;  // what they do to variances, of what the others are worth
  double of_swing = 0, of_faces = 0, of_strays = 0;
  for (const Suspect& s : result.accepted) {
    if (is(s, ids::settling)) of_swing = may_be_of_its_formula(s);
    if (is(s, ids::facet_wobble)) of_faces = may_be_of_its_formula(s);
    if (is(s, ids::outliers)) of_strays = unseen_strays * s.gain;
  }
  // Every face has the range that is seen of it: only what differs from turn to turn of the mirror is left.
  distrust_noise(std::max(of_swing, of_strays), std::max({of_swing, of_faces, of_strays}), result);
}

}  // namespace fit::explain::spread
