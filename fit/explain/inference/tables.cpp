// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "fit/explain/inference/runs.hpp"
#include "fit/explain/inference/steps.hpp"

namespace fit::explain::inference {
namespace {

using Eigen::Index;

/// What a term of a fitted hypothesis does in a channel beyond its formula.
Eigen::VectorXd bend_of(const Fitted& f, std::size_t term, std::size_t channel) {
  const Design::Block& block = f.design.blocks[term];
  const Design::Part& part = f.design.parts[channel];
  Eigen::VectorXd bend = Eigen::VectorXd::Zero(part.columns.rows());
  part.add(part.columns, f.optimum.x, bend, block.first_deviation(), block.end());
  return bend;
}

/// Means of what happens over stretches of the coordinate; never two places for one value of it.
EmpiricalFunction tabulated(const Session& session, const Kind& kind, std::size_t channel,
                            const Eigen::VectorXd& happens) {
  constexpr std::size_t places = 150;
  const ChannelRows& rows = *session.channels()[channel];
  const Coordinate coordinate = kind.mechanism->coordinate;
  const bool on_a_target = coordinate == Coordinate::target && kind.target >= 0;
  EmpiricalFunction table{
      on_a_target ? "along_mm" : name_of(coordinate), model::channel_kinds()[channel].table, "", {}, {}};
  if (kind.target >= 0) table.target = session.reduced().bench.target_at(kind.target).name;
  std::vector<WeighedValue> list;
  for (Index i = 0; i < rows.rows(); ++i) {
    const double at = model::place_of(coordinate, kind.target, rows.at(i));
    if (std::isfinite(at) && (kind.target < 0 || rows.at(i).target == kind.target))
      list.push_back({at, happens[i]});
  }
  const std::size_t each = 1 + list.size() / places;
  RunMeans means = means_over_runs(std::move(list), each);
  table.at = std::move(means.at);
  table.value = std::move(means.value);
  return table;
}

}  // namespace

std::vector<EmpiricalFunction> tables_of(const Session& session, const Fitted& best,
                                         const Posterior& posterior) {
  std::vector<EmpiricalFunction> tables;
  const std::vector<Term>& terms = best.hypothesis.terms;
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const Kind& kind = *terms[t].kind;
    const bool has_name =
        std::ranges::any_of(posterior.named, [&](const Named& n) { return n.term.kind == &kind; });
    for (std::size_t c = 0; c < session.channels().size(); ++c) {
      if (!kind.acts_in[c] || model::channel_kinds()[c].table.empty()) continue;
      Eigen::VectorXd happens = bend_of(best, t, c);
      if (!has_name) happens += model::effect_of(*session.channels()[c], kind, terms[t].values);
      if (happens.cwiseAbs().maxCoeff() == 0) continue;
      if (EmpiricalFunction table = tabulated(session, kind, c, happens); table.at.size() > 1)
        tables.push_back(std::move(table));
    }
  }
  return tables;
}

}  // namespace fit::explain::inference
