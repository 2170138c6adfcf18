// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include "fit/explain/inference/steps.hpp"
#include "fit/explain/scene/stated_noise.hpp"

namespace fit::explain::inference {
namespace {

using Eigen::Index;

/// How rows show what a term does: where on its coordinate, in which unit, and by how much of the statistic
/// per unit.
struct View {
  Coordinate coordinate;
  std::string unit;
  double every = 0;         ///< What repeats after so many is drawn once; 0: nothing does.
  bool since_move = false;  ///< Drawn along that time, an angle towards where the stage came from.
  Eigen::VectorXd per_unit;

  View(Coordinate along, const ChannelRows& rows, const model::ChannelKind& channel)
      : coordinate(along), unit(channel.unit), per_unit(Eigen::VectorXd::Ones(rows.rows())) {}
  View(const Term& term, const ChannelRows& rows, const model::ChannelKind& channel)
      : coordinate(is_constant_noise(*term.kind->mechanism) ? Coordinate::beam
                                                            : term.kind->mechanism->coordinate),
        unit(channel.unit),
        per_unit(Eigen::VectorXd::Ones(rows.rows())) {
    if (const auto count = term.kind->mechanism->parameter_of(Parameter::Scale::count))
      every = term.values[*count];
    if (coordinate != Coordinate::scan_seq || channel.is_square) return;
    Effect all;
    for (Index i = 0; i < rows.rows(); ++i) {
      const Effect effect = term.kind->mechanism->act(rows.at(i), term.values);
      all.range_mm += std::abs(effect.range_mm);
      all.stage_rad += std::abs(effect.stage_rad);
      per_unit[i] = rows.response(i, {.stage_rad = rad_per_deg}) * (rows.at(i).approach < 0 ? -1 : 1);
    }
    since_move = all.range_mm == 0 && all.stage_rad > 0;
    if (since_move)
      unit = "deg";
    else
      for (Index i = 0; i < rows.rows(); ++i) per_unit[i] = rows.response(i, {.range_mm = 1});
  }
  [[nodiscard]] double place_of(const ChannelRows& rows, Index i) const {
    const double place = since_move ? rows.at(i).since_move_s : model::coordinate_of(coordinate, rows.at(i));
    return every > 0 ? std::fmod(place, every) : place;
  }
};

SpreadCurve curve_in(const View& view, const ChannelRows& rows, const model::ChannelKind& channel,
                     const Eigen::VectorXd& before, const Eigen::VectorXd& after) {
  constexpr double points = 30;
  SpreadCurve curve;
  curve.shows = view.since_move ? "stage angle after a move, from its mean" : channel.shows;
  curve.unit = view.unit;
  curve.observable = channel.observable;
  curve.coordinate = view.since_move ? Coordinate::time : view.coordinate;
  if (view.since_move) curve.along = "time since the move (s)";
  std::vector<Index> order;
  for (Index i = 0; i < rows.rows(); ++i)
    if (std::isfinite(view.place_of(rows, i)) && view.per_unit[i] != 0) order.push_back(i);
  const auto place_of = [&](Index i) { return view.place_of(rows, i); };
  std::ranges::sort(order, {}, place_of);
  const Eigen::VectorXd weight =
      rows.information(rows.expansion_for_new_terms(after)).cwiseProduct(view.per_unit.cwiseAbs2());
  const double each = weight.sum() / points;
  const auto shown = [&](double eta) { return channel.is_square ? std::sqrt(std::max(0.0, eta)) : eta; };
  double sum = 0, place = 0, seen = 0, simulated = 0, explained = 0;
  for (std::size_t k = 0; k < order.size(); ++k) {
    const Index i = order[k];
    sum += weight[i];
    place += weight[i] * place_of(i);
    seen += weight[i] * rows.seen(i) / view.per_unit[i];
    simulated += weight[i] * before[i] / view.per_unit[i];
    explained += weight[i] * after[i] / view.per_unit[i];
    const bool goes_on = k + 1 < order.size() && place_of(order[k + 1]) == place_of(i);
    if (!(sum > 0) || goes_on || (sum < each && k + 1 < order.size())) continue;
    const double recorded = shown(seen / sum), u = 1 / std::sqrt(sum);
    curve.add(place / sum, {recorded, channel.is_square ? u / std::max(1e-9, 2 * recorded) : u},
              shown(simulated / sum), shown(explained / sum));
    sum = place = seen = simulated = explained = 0;
  }
  return curve;
}

}  // namespace

std::vector<SpreadCurve> curves_of(const Session& session, const Fitted& nothing, const Fitted& best,
                                   const Posterior& posterior) {
  std::vector<const Term*> found;
  for (const auto* list : {&posterior.named, &posterior.forms})
    for (const Named& named : *list) found.push_back(&named.term);
  for (const Undecided& set : posterior.undecided)
    for (const auto& member : set.members)
      if (member.term.kind) found.push_back(&member.term);
  std::vector<SpreadCurve> curves;
  std::set<std::pair<std::size_t, Coordinate>> drawn;
  const auto draw = [&](std::size_t c, const auto& what) {  // a term, or a coordinate
    const ChannelRows& rows = *session.channels()[c];
    const model::ChannelKind& channel = model::channel_kinds()[c];
    const View view(what, rows, channel);
    const Eigen::VectorXd &before = nothing.optimum.eta[c], &after = best.optimum.eta[c];
    std::optional<SpreadCurve> curve = rows.picture(before, after);
    if (!drawn.insert({c, curve ? Coordinate::beam : view.coordinate}).second) return;
    if (!curve) curve = curve_in(view, rows, channel, before, after);
    if (curve->at.size() > 1) curves.push_back(std::move(*curve));
  };
  for (const Term* term : found)
    for (std::size_t c = 0; c < session.channels().size(); ++c)
      if (!model::channel_kinds()[c].of_predicted && term->kind->acts_in[c]) draw(c, *term);
  for (std::size_t c = 0; c < session.channels().size(); ++c)
    for (const Coordinate coordinate : model::channel_kinds()[c].always_drawn)
      if (session.channels()[c]) draw(c, coordinate);
  return curves;
}

}  // namespace fit::explain::inference
