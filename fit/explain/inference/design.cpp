// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <limits>

#include "fit/explain/inference/fit.hpp"
#include "fit/numeric/products.hpp"

namespace fit::explain::inference {

using Eigen::Index;

namespace {

/// Grows the coefficients by so many with that prior.
void add_coefficients(Design& design, const Prior& prior) {
  const Index had = design.mean.size(), more = prior.mean.size();
  design.mean.conservativeResize(had + more);
  design.sigma.conservativeResize(had + more);
  design.sigma.tail(more) = units_of(prior.sigma);
  design.mean.tail(more) = prior.mean.cwiseQuotient(design.sigma.tail(more));
  constexpr double any = std::numeric_limits<double>::infinity();
  design.lower.conservativeResize(had + more);
  design.upper.conservativeResize(had + more);
  design.lower.tail(more).setConstant(-any);
  design.upper.tail(more).setConstant(any);
}

/// Columns from that coefficient on, scaled by its prior.
void add_columns(Design& design, std::size_t channel, Index first, const Eigen::MatrixXd& columns) {
  if (columns.cols() == 0) return;
  Design::Part& part = design.parts[channel];
  const Index had = part.columns.cols();
  part.columns.conservativeResize(columns.rows(), had + columns.cols());
  for (Index k = 0; k < columns.cols(); ++k) {
    part.columns.col(had + k) = columns.col(k) * design.sigma[first + k];
    part.index.push_back(first + k);
  }
}

void add_base(const Session& session, Design& design) {
  for (std::size_t c = 0; c < session.channels().size(); ++c) {
    design.parts[c].offset = session.offset(c);
    if (!session.channels()[c]) continue;
    const Columns& base = session.channels()[c]->base();
    design.parts[c].columns.resize(session.channels()[c]->rows(), 0);
    const Index first = design.mean.size();
    add_coefficients(design, base.prior);
    add_columns(design, c, first, base.columns);
  }
}

/// How far shapes may go from where they are, in standard deviations of their uniform prior.
void bound_shapes(const Term& term, Index first, Design& design) {
  const std::vector<std::size_t> shapes = model::refined_shapes_of(*term.kind);
  for (std::size_t j = 0; j < shapes.size() && first + static_cast<Index>(j) < design.mean.size(); ++j) {
    const Parameter& p = term.kind->mechanism->parameters[shapes[j]];
    const auto in = [&](double v) { return p.logarithmic ? std::log(v) : v; };
    const double unit = (in(p.upper) - in(p.lower)) / std::sqrt(12.0), now = in(term.values[shapes[j]]);
    design.lower[first + static_cast<Index>(j)] = std::min(0.0, (in(p.lower) - now) / unit);
    design.upper[first + static_cast<Index>(j)] = std::max(0.0, (in(p.upper) - now) / unit);
  }
}

void add_term(const Session& session, const Term& term, Design& design) {
  const Kind& kind = *term.kind;
  Design::Block block;
  block.first = design.mean.size();
  add_coefficients(design, prior_of(kind, term.factor));
  block.sizes = design.mean.size() - block.first;
  for (Index k = 0; k < block.sizes; ++k) {
    const model::Coefficient& c = kind.coefficients[static_cast<std::size_t>(k)];
    const Index at = block.first + k;
    if (std::isfinite(c.largest) && !c.has_phase) {
      design.upper[at] = c.largest / design.sigma[at];
      design.lower[at] = -design.upper[at];
    }
    if (c.sign > 0) design.lower[at] = 0;
  }
  std::vector<Eigen::MatrixXd> shapes(session.channels().size()), deviations(session.channels().size());
  for (std::size_t c = 0; c < session.channels().size(); ++c) {
    if (!kind.acts_in[c]) continue;
    const ChannelRows& rows = *session.channels()[c];
    add_columns(design, c, block.first, model::columns_of(rows, kind, term.values, &kind.acts_in[c]));
    if (kind.acts_in[c].without_size)
      design.parts[c].offset += model::effect_without_size(rows, kind, term.values);
    shapes[c] = model::shape_columns(rows, term);
    model::Deviations all = model::deviations_of(rows, term);
    block.of_formula = std::max(block.of_formula, all.of_formula);
    deviations[c] = std::move(all.columns);
    block.shapes = std::max(block.shapes, shapes[c].cols());
    block.deviations = std::max(block.deviations, deviations[c].cols());
  }
  add_coefficients(design, Prior::around_zero(block.shapes));
  bound_shapes(term, design.mean.size() - block.shapes, design);
  add_coefficients(design, Prior::around_zero(block.deviations));
  for (std::size_t c = 0; c < session.channels().size(); ++c) {
    add_columns(design, c, block.first_shape(), shapes[c]);
    add_columns(design, c, block.first_shape() + block.shapes, deviations[c]);
  }
  design.blocks.push_back(block);
}

/// The base is whitened already.
void add_fixed(const Session& session, Design& design) {
  for (std::size_t c = 0; c < design.parts.size(); ++c) {
    Design::Part& part = design.parts[c];
    part.fixed = session.white_base(c);
    if (!part.fixed) continue;
    const Index known = part.fixed->white.cols(), more = part.columns.cols() - known;
    if (more == 0) continue;
    const Squared added = squared(session.channels()[c]->whitened(part.columns.rightCols(more), {}));
    const Eigen::MatrixXd cross = transpose_product(part.fixed->white, added.white);
    Squared all{Eigen::MatrixXd(added.white.rows(), known + more),
                Eigen::MatrixXd(known + more, known + more)};
    all.white << part.fixed->white, added.white;
    all.square << part.fixed->square, cross, cross.transpose(), added.square;
    part.fixed = std::make_shared<const Squared>(std::move(all));
  }
}

}  // namespace

void Design::Part::add(const Eigen::MatrixXd& by, const Eigen::VectorXd& x, Eigen::VectorXd& sum, Index first,
                       Index last) const {
  for (std::size_t k = 0; k < index.size(); ++k)
    if (index[k] >= first && index[k] < last) sum += by.col(static_cast<Index>(k)) * x[index[k]];
}

void hold_shapes(const Design& design, double known, Eigen::MatrixXd& information) {
  for (const Design::Block& block : design.blocks)
    for (Index k = block.first_shape(); k < block.first_shape() + block.shapes; ++k) {
      information.row(k).setZero();
      information.col(k).setZero();
      information(k, k) = known;
    }
}

Design design_of(const Session& session, const std::vector<Term>& terms) {
  Design design;
  design.parts.resize(session.channels().size());
  add_base(session, design);
  for (const Term& term : terms) add_term(session, term, design);
  add_fixed(session, design);
  return design;
}

}  // namespace fit::explain::inference
