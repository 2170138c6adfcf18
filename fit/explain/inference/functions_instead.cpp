// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <set>

#include "fit/explain/inference/alike.hpp"
#include "fit/explain/numbers.hpp"

namespace fit::explain::inference {
namespace {

/// Whether it is an unnamed function of what the mechanism acts on, whatever its coordinate.
bool is_function_where_acts(const Kind& form, const Kind& mechanism) {
  return form.is_form() && std::ranges::count(mechanism.ways, form.functions->changes) > 0;
}

/// What a term of the best hypothesis does to all channels, by their information there.
std::vector<Eigen::VectorXd> effect_of(const Fitted& best, const Kind& kind) {
  std::size_t t = 0;
  while (best.hypothesis.terms[t].kind != &kind) ++t;
  const Design::Block& block = best.design.blocks[t];
  std::vector<Eigen::VectorXd> effect;
  for (std::size_t c = 0; c < best.optimum.white.size(); ++c) {
    effect.push_back(Eigen::VectorXd::Zero(best.optimum.white[c].rows()));
    best.design.parts[c].add(best.optimum.white[c], best.optimum.x, effect.back(), block.first, block.end());
  }
  return effect;
}

/// What a function that is the same everywhere does to a channel.
Eigen::VectorXd constant_function(const ChannelRows& rows, double Effect::*changes) {
  Effect everywhere;
  everywhere.*changes = 1;
  return Eigen::VectorXd::NullaryExpr(rows.rows(),
                                      [&](Eigen::Index i) { return rows.response(i, everywhere); });
}

/// Log-likelihood that an effect loses where functions of that kind and a constant stand for it, nuisances as
/// their priors allow.
double loss_as_function(const Session& session, const Fitted& best, const Kind& form,
                        const std::vector<double>& values, const std::vector<Eigen::VectorXd>& effect) {
  double loss = 0;
  for (std::size_t c = 0; c < effect.size(); ++c) {
    if (effect[c].isZero(0)) continue;
    Eigen::MatrixXd functions(effect[c].size(), 0);
    if (form.acts_in[c]) {
      const ChannelRows& rows = *session.channels()[c];
      functions = model::columns_of(rows, form, values);
      functions.conservativeResize(Eigen::NoChange, functions.cols() + 1);
      functions.rightCols(1) = constant_function(rows, form.functions->changes);
      functions = rows.whitened(std::move(functions), best.optimum.eta[c]);
    }
    const Eigen::Index nuisances = session.channels()[c]->base().prior.mean.size(),
                       all = functions.cols() + nuisances;
    Eigen::MatrixXd columns(effect[c].size(), all);
    columns << functions, best.optimum.white[c].leftCols(nuisances);
    Eigen::MatrixXd information = columns.transpose() * columns;
    information.diagonal().tail(nuisances).array() += 1;
    const Eigen::VectorXd pull = columns.transpose() * effect[c];
    loss += (effect[c].squaredNorm() - pull.dot(information.ldlt().solve(pull))) / 2;
  }
  return loss;
}

/// Of less than two periods nobody sees that something repeats.
bool may_not_repeat(const Session& session, const Term& term) {
  const Mechanism& m = *term.kind->mechanism;
  const auto period = m.parameter_of(Parameter::Scale::wavelength);
  const auto& means = session.channels()[model::channel_of("mean")];
  if (!period || !means) return false;
  std::vector<double> places;
  for (Eigen::Index i = 0; i < means->rows(); ++i)
    if (const double at = model::coordinate_of(m.coordinate, means->at(i)); std::isfinite(at))
      places.push_back(at);
  if (places.empty()) return false;
  std::ranges::sort(places);
  const auto quantile = [&](double share) {
    return places[static_cast<std::size_t>(share * static_cast<double>(places.size() - 1))];
  };
  return quantile(0.95) - quantile(0.05) < 2 * term.values[*period];
}

/// Whether what is there is no more than anything in its place would do.
bool lacks_own_sign(const Term& term) {
  const Mechanism& m = *term.kind->mechanism;
  return m.has_own_sign && term.sigma.size() == term.values.size() && !m.happened_once(term.values) &&
         !m.has_own_sign(term.values, term.sigma);
}

}  // namespace

std::vector<Named> functions_instead(const Session& session, const Fitted& best, const Named& named) {
  if (!best.hypothesis.has(*named.term.kind)) return {};  // named by many others that outweigh the best
  std::vector<Eigen::VectorXd> effect = effect_of(best, *named.term.kind);
  double gain = 0;
  for (const Eigen::VectorXd& in_channel : effect) gain += in_channel.squaredNorm() / 2;
  const bool may_be_any = may_not_repeat(session, named.term) || lacks_own_sign(named.term);
  std::set<Coordinate> coordinates;
  if (may_be_any) coordinates.insert(named.term.kind->mechanism->coordinate);
  for (const Term& own : best.hypothesis.terms) {
    if (!is_function_where_acts(*own.kind, *named.term.kind)) continue;
    coordinates.insert(own.kind->mechanism->coordinate);
    const std::vector<Eigen::VectorXd> of_function = effect_of(best, *own.kind);
    for (std::size_t c = 0; c < effect.size(); ++c) effect[c] += of_function[c];
  }
  if (coordinates.empty()) return {};
  for (const Kind& kind : session.kinds()) {
    if (!is_function_where_acts(kind, *named.term.kind) ||
        !coordinates.contains(kind.mechanism->coordinate) ||
        !(kind.form->form->scaled || kind.form->form->of_all_targets))
      continue;
    for (const std::vector<double>& values : kind.starts)
      if (may_be_any || loss_as_function(session, best, kind, values, effect) <
                            equivalence_margin(named.term.kind->mechanism->formula_error, gain))
        return {{{.kind = &kind, .values = values, .sigma = {}}, named.probability}};
  }
  return {};
}

}  // namespace fit::explain::inference
