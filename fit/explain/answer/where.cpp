// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "fit/explain/answer/chapters.hpp"
#include "fit/explain/model/term.hpp"

namespace fit::explain::answer {
namespace {

double p_value(double evidence) { return std::exp(-std::clamp(evidence, 0.0, 600.0)); }

/// What was recorded of a coordinate, if anything.
std::optional<Recorded> recorded(const Reduced& reduced, Coordinate coordinate) {
  Extent all;
  for (const Cell& cell : reduced.cells) all.add(model::coordinate_of(coordinate, cell.at));
  if (coordinate == Coordinate::scan_seq)
    for (const Sector& s : reduced.sectors) all.add(s.seq);
  if (!(all.high >= all.low)) return {};
  return Recorded{all.low, all.high, reduced.bench.lidar.scan_hz};
}

std::vector<Located> located(const Suspect& suspect, const Reduced& reduced) {
  const Mechanism& m = *suspect.mechanism;
  const auto there = recorded(reduced, m.coordinate);
  if (!there) return {};
  Finding finding;
  finding.parameters = suspect.parameters;
  const std::vector<Interval> intervals =
      m.shows ? m.shows(finding, *there) : std::vector<Interval>{{m.coordinate, there->from, there->to}};
  std::vector<Located> list;
  for (const Interval& s : intervals)
    list.push_back({s.coordinate, s.from, s.to, m.observable, p_value(suspect.gain)});
  return list;
}

/// Where it acts, or if it does not say so, wherever there is a recording.
Located located(const Unexplained& u, const Reduced& reduced) {
  Located l{u.coordinate, u.from, u.to, u.observable, p_value(u.gain)};
  if (const auto there = recorded(reduced, u.coordinate); there && !(u.to > u.from)) {
    l.from = there->from;
    l.to = there->to;
  }
  return l;
}

/// `before`: the means before anything was explained.
void locate(const MeanModel& before, const Reduced& reduced, const Inferred& inferred,
            std::vector<Located>& out, bool reports_unknown) {
  const Hypothesis& best = inferred.means.best;
  const auto add = [&](const std::vector<Located>& list) {
    std::ranges::copy(list, std::back_inserter(out));
  };
  std::set<Coordinate> taken;
  for (const Term& term : best.terms)
    if (taken.insert(term.mechanism->coordinate).second)
      add(locate_effect(before, effect_of(before, term), term.mechanism->coordinate));
  for (const Shape& shape : best.shapes)
    if (taken.insert(shape.coordinate).second)
      add(locate_effect(before, effect_of(before, shape), shape.coordinate));
  for (const Suspect& suspect : inferred.accepted) add(located(suspect, reduced));
  if (reports_unknown && best.shapes.empty())
    for (const Unexplained& u : inferred.unknown) out.push_back(located(u, reduced));
  if (!best.terms.empty() || !best.shapes.empty())
    for (const Located& l : locate_residuals(before, 0.01))
      if (!taken.contains(l.coordinate)) out.push_back(l);
  for (Located& l : out) {
    if (l.coordinate != Coordinate::temperature) continue;
    l.from += reduced.reference_temperature_c;
    l.to += reduced.reference_temperature_c;
  }
}

/// A curve for every coordinate of what was found, and for beam, range and time.
std::vector<Curve> curves(const MeanModel& before, const MeanModel& after, const Hypothesis& best) {
  std::vector<Coordinate> wanted;
  for (const Term& term : best.terms) wanted.push_back(term.mechanism->coordinate);
  for (const Shape& shape : best.shapes) wanted.push_back(shape.coordinate);
  for (const Coordinate c : {Coordinate::beam, Coordinate::range, Coordinate::time}) wanted.push_back(c);
  std::set<Coordinate> drawn;
  std::vector<Curve> list;
  for (const Coordinate c : wanted) {
    if (!drawn.insert(c).second) continue;
    Curve curve = curve_of(before, after, c);
    if (curve.at.size() > 1) list.push_back(std::move(curve));
  }
  return list;
}

}  // namespace

void report_where(const Reduced& reduced, const Inferred& inferred, Explanation& out) {
  const MeanResult& means = inferred.means;
  Hypothesis nothing(reduced.bench);
  nothing.nuisance = means.best.nuisance;
  Reduced rows = merged(reduced, rows_for_tables);
  predict_at(rows, nothing);
  const MeanModel before = model_of(rows, means.noise, nothing);
  locate(before, reduced, inferred, out.located, out.unknown.has_value());
  Reduced explained = rows;
  predict_at(explained, means.best);
  const MeanModel after = model_of(explained, means.noise, means.best);
  out.curves = curves(before, after, means.best);
}

}  // namespace fit::explain::answer
