// SPDX-License-Identifier: MIT
#include "fit/explain/inference/curves.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include "fit/explain/stated_noise.hpp"

namespace fit::explain::inference {
namespace {

using Eigen::Index;

SpreadCurve curve_along(const ChannelRows& rows, const model::ChannelKind& channel, Coordinate coordinate,
                        const Eigen::VectorXd& before, const Eigen::VectorXd& after) {
  constexpr double points = 30;
  SpreadCurve curve;
  curve.shows = channel.shows;
  curve.unit = channel.unit;
  curve.observable = channel.observable;
  curve.coordinate = coordinate;
  std::vector<Index> order;
  for (Index i = 0; i < rows.rows(); ++i)
    if (std::isfinite(model::coordinate_of(coordinate, rows.at(i)))) order.push_back(i);
  const auto place_of = [&](Index i) { return model::coordinate_of(coordinate, rows.at(i)); };
  std::ranges::sort(order, {}, place_of);
  const Eigen::VectorXd weight =
      rows.whitened(Eigen::VectorXd::Ones(rows.rows()), rows.raised(after)).cwiseAbs2();
  const double each = weight.sum() / points;
  const auto shown = [&](double eta) { return channel.is_square ? std::sqrt(std::max(0.0, eta)) : eta; };
  double sum = 0, place = 0, seen = 0, simulated = 0, explained = 0;
  for (std::size_t k = 0; k < order.size(); ++k) {
    const Index i = order[k];
    sum += weight[i];
    place += weight[i] * place_of(i);
    seen += weight[i] * rows.seen(i);
    simulated += weight[i] * before[i];
    explained += weight[i] * after[i];
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
      if (member.kind) found.push_back(&member.term);
  std::vector<SpreadCurve> curves;
  const std::size_t means = model::channel_of("mean");
  std::set<std::pair<std::size_t, Coordinate>> drawn;
  for (const Term* term : found)
    for (std::size_t c = 0; c < session.channels().size(); ++c) {
      if (c == means || !term->kind->acts_in[c]) continue;
      const Coordinate along =
          is_constant_noise(*term->kind->mechanism) ? Coordinate::beam : term->kind->mechanism->coordinate;
      if (!drawn.insert({c, along}).second) continue;
      SpreadCurve curve = curve_along(*session.channels()[c], model::channel_kinds()[c], along,
                                      nothing.optimum.eta[c], best.optimum.eta[c]);
      if (curve.at.size() > 1) curves.push_back(std::move(curve));
    }
  return curves;
}

}  // namespace fit::explain::inference
