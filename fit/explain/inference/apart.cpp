// SPDX-License-Identifier: MIT
#include "fit/explain/inference/apart.hpp"

#include "fit/explain/model/term.hpp"

namespace fit::explain::inference {
namespace {

using Eigen::Index;
using Channels = std::vector<std::unique_ptr<model::ChannelRows>>;

/// Those beside the means.
Channels channels_of(const Reduced& reduced) {
  Channels channels;
  const std::vector<Active> known = known_effects(reduced.bench);
  for (const model::ChannelKind& kind : model::channel_kinds()) {
    channels.push_back(kind.of_predicted ? nullptr : kind.rows(reduced, {}));
    if (channels.back()) append_uncertainty(known, *channels.back());
  }
  return channels;
}

/// The predictor where nothing is missing.
Eigen::VectorXd base_predictor(const model::ChannelRows& rows) {
  return Eigen::VectorXd::NullaryExpr(rows.rows(), [&](Index i) { return rows.offset(i); }) +
         rows.base().columns * rows.base().prior.mean;
}

/// What a suspect, or nothing, may do in a channel, whatever its size: as it came out, and as its shapes and
/// formula bend.
Eigen::MatrixXd all_that(const model::ChannelRows& rows, std::size_t channel, const model::Term& suspect) {
  const Columns& base = rows.base();
  const Eigen::MatrixXd nuisances = base.columns * base.prior.sigma.asDiagonal();
  if (!suspect.kind || !suspect.kind->acts_in[channel]) return nuisances;
  const model::Kind::Acting& acts = suspect.kind->acts_in[channel];
  constexpr double any_size = 100;  // of a typical one
  const Eigen::MatrixXd sizes = any_size * model::columns_of(rows, *suspect.kind, suspect.values, &acts),
                        shapes = model::shape_columns(rows, suspect),
                        deviations = model::deviations_of(rows, suspect).columns;
  Eigen::MatrixXd all(rows.rows(), nuisances.cols() + sizes.cols() + shapes.cols() + deviations.cols());
  all << nuisances, sizes, shapes, deviations;
  return all;
}

double left_by(const Channels& channels, const model::Term& truth, const model::Term& rival) {
  double sum = 0;
  for (std::size_t c = 0; c < channels.size(); ++c) {
    if (!channels[c] || !truth.kind->acts_in[c]) continue;
    const model::ChannelRows& rows = *channels[c];
    const Eigen::VectorXd effect = model::effect_of(rows, *truth.kind, truth.values),
                          eta = base_predictor(rows) + effect, white = rows.whitened(effect, eta);
    const Eigen::MatrixXd columns = rows.whitened(all_that(rows, c, rival), eta);
    Eigen::MatrixXd square = columns.transpose() * columns;
    square.diagonal().array() += 1;
    const Eigen::VectorXd along = columns.transpose() * white;
    sum += 0.5 * (white.squaredNorm() - along.dot(square.llt().solve(along)));
  }
  return sum;
}

}  // namespace

Eigen::MatrixXd evidence_between(const Reduced& reduced, const std::vector<Suspect>& suspects,
                                 bool may_be_nothing) {
  const Channels channels = channels_of(reduced);
  std::vector<model::Kind> kinds;
  for (const Suspect& suspect : suspects)
    kinds.push_back(model::kind_of(*suspect.mechanism, suspect.target, channels));
  std::vector<model::Term> terms;
  for (std::size_t i = 0; i < suspects.size(); ++i) {
    terms.emplace_back();
    terms.back().kind = &kinds[i];
    terms.back().values = suspects[i].mechanism->values(suspects[i].parameters);
  }
  if (may_be_nothing) terms.emplace_back();
  const auto count = static_cast<Index>(terms.size());
  Eigen::MatrixXd evidence = Eigen::MatrixXd::Zero(count, count);
  for (Index i = 0; i < static_cast<Index>(suspects.size()); ++i)
    for (Index j = 0; j < count; ++j)
      if (i != j)
        evidence(i, j) =
            left_by(channels, terms[static_cast<std::size_t>(i)], terms[static_cast<std::size_t>(j)]);
  return evidence;
}

}  // namespace fit::explain::inference
