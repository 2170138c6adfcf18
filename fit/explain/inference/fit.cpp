// SPDX-License-Identifier: MIT
#include "fit/explain/inference/fit.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <utility>

#include "fit/dense.hpp"
#include "fit/explain/inference/numbers.hpp"

namespace fit::explain::inference {

using Eigen::Index;

namespace {

Eigen::VectorXd predictor(const Design::Part& part, const Eigen::VectorXd& x) {
  Eigen::VectorXd eta = part.offset;
  for (std::size_t k = 0; k < part.index.size(); ++k)
    eta += part.columns.col(static_cast<Index>(k)) * x[part.index[k]];
  return eta;
}

/// Log of the posterior density there, up to a constant of the priors.
void judge_there(const Session& session, const Design& design, Optimum& there) {
  there.eta.clear();
  there.of_channel.clear();
  for (std::size_t c = 0; c < design.parts.size(); ++c) {
    const auto& rows = session.channels()[c];
    there.eta.push_back(rows ? predictor(design.parts[c], there.x) : Eigen::VectorXd());
    there.of_channel.push_back(rows ? rows->log_likelihood(there.eta[c]) : 0);
  }
  there.log_likelihood = std::accumulate(there.of_channel.begin(), there.of_channel.end(), 0.0);
  there.log_posterior = there.log_likelihood - 0.5 * (there.x - design.mean).squaredNorm();
}

/// Gradient and information of the posterior there.
struct Scored {
  Eigen::VectorXd gradient;
  Eigen::MatrixXd information;
};

/// What a quadratic approximation is for.
enum class For {
  steps,     ///< From there, however far.
  evidence,  ///< Of what is there.
  new_terms  ///< Linearised at as much as the rows are on the whole.
};
/// Whitened columns with their squares.
struct Squared {
  Eigen::MatrixXd white, square;
  explicit Squared(Eigen::MatrixXd columns)
      : white(std::move(columns)), square(Eigen::MatrixXd::Zero(white.cols(), white.cols())) {
    square.selfadjointView<Eigen::Lower>().rankUpdate(white.transpose());
    square.triangularView<Eigen::StrictlyUpper>() = square.transpose();
  }
};
/// By channel, of those whose information is the same anywhere.
using Fixed = std::map<std::size_t, Squared>;

Scored scored(const Session& session, const Design& design, Optimum& there, Fixed& fixed,
              For what = For::steps) {
  const bool raised = what == For::new_terms;
  const Index k = design.mean.size();
  Scored s{design.mean - there.x, Eigen::MatrixXd::Identity(k, k)};
  there.white.assign(design.parts.size(), {});
  there.white_residual.assign(design.parts.size(), {});
  for (std::size_t c = 0; c < design.parts.size(); ++c) {
    if (!session.channels()[c]) continue;
    const ChannelRows& rows = *session.channels()[c];
    const Eigen::VectorXd eta = raised ? rows.possible(there.eta[c]) : there.eta[c];
    const Eigen::VectorXd at = raised               ? rows.raised(eta)
                               : what == For::steps ? rows.steady(eta)
                                                    : rows.curved(eta);
    const auto squared = [&] { return Squared(rows.whitened(design.parts[c].columns, at)); };
    const auto known = fixed.find(c);
    std::optional<Squared> here;
    const Squared& columns = known != fixed.end()           ? known->second
                             : rows.has_fixed_information() ? fixed.emplace(c, squared()).first->second
                                                            : here.emplace(squared());
    there.white_residual[c] = rows.white_residual(raised ? at : eta);
    if (raised)
      there.white_residual[c] += rows.whitened(at - eta, at);
    else if (at != eta)  // the same score over another root of the information
      there.white_residual[c] = there.white_residual[c].cwiseProduct(
          rows.information(eta).cwiseQuotient(rows.information(at)).cwiseSqrt());
    there.white[c] = columns.white;
    const std::vector<Index>& index = design.parts[c].index;
    s.gradient(index) += columns.white.transpose() * there.white_residual[c];
    s.information(index, index) += columns.square;
  }
  return s;
}

/// A scoring step of all coefficients that are not held at their bound, shortened by a damping (Levenberg and
/// Marquardt); and by how much the quadratic approximation says that it gains.
struct Step {
  Eigen::VectorXd by;
  double promises = 0;
};
Step step_of(const Scored& s, const Design& design, const Eigen::VectorXd& x, double damping = 0) {
  Scored free = s;
  free.information.diagonal() *= 1 + damping;
  for (Index k = 0; k < x.size(); ++k) {
    const bool held =
        (x[k] <= design.lower[k] && s.gradient[k] <= 0) || (x[k] >= design.upper[k] && s.gradient[k] >= 0);
    if (!held) continue;
    free.information.row(k).setZero();
    free.information.col(k).setZero();
    free.information(k, k) = 1;
    free.gradient[k] = 0;
  }
  const Eigen::VectorXd by = free.information.llt().solve(free.gradient);
  return {by, 0.5 * by.dot(free.gradient)};
}

Eigen::VectorXd within_bounds(const Design& design, const Eigen::VectorXd& x) {
  return x.cwiseMax(design.lower).cwiseMin(design.upper);
}

Optimum judged_at(const Session& session, const Design& design, const Eigen::VectorXd& x) {
  Optimum there;
  there.x = within_bounds(design, x);
  judge_there(session, design, there);
  return there;
}

/// Uphill from there by scoring steps.
Optimum climbed(const Session& session, const Design& design, Optimum now) {
  constexpr int most_steps = 16;
  constexpr double settled = 1e-4, first_damping = 0.3, most_damping = 1e4;
  Fixed fixed;
  Scored s = scored(session, design, now, fixed);
  double damping = 0;
  for (int step = 0; step < most_steps; ++step) {
    const Step whole = step_of(s, design, now.x, damping);
    if (whole.promises < settled) break;
    Optimum next = judged_at(session, design, now.x + whole.by);
    while (next.log_posterior < now.log_posterior && damping < most_damping) {
      damping = std::max(first_damping, 8 * damping);
      next = judged_at(session, design, now.x + step_of(s, design, now.x, damping).by);
    }
    if (next.log_posterior < now.log_posterior) break;
    damping = damping > first_damping ? damping / 8 : 0;
    now = std::move(next);
    s = scored(session, design, now, fixed);
  }
  now.factor.compute(s.information);
  return now;
}

/// Sizes that have a sign (variances, hazards) and act where the information depends on where it is: there a
/// likelihood may be flat and rise again farther on.
std::vector<Index> uneven_sizes(const Session& session, const Design& design) {
  std::vector<Index> list;
  for (const Design::Block& block : design.blocks)
    for (Index k = block.first; k < block.first_shape(); ++k) {
      bool uneven = false;
      for (std::size_t c = 0; c < design.parts.size() && design.lower[k] == 0; ++c) {
        const auto& rows = session.channels()[c];
        if (!rows || rows->has_fixed_information()) continue;
        const std::vector<Index>& index = design.parts[c].index;
        const auto at = std::ranges::find(index, k);
        uneven = uneven || (at != index.end() && !design.parts[c].columns.col(at - index.begin()).isZero());
      }
      if (uneven) list.push_back(k);
    }
  return list;
}

}  // namespace

Optimum optimum_of(const Session& session, const Design& design, const Eigen::VectorXd& start) {
  Optimum now = judged_at(session, design, design.mean);
  if (start != design.mean) {
    Optimum nearer = judged_at(session, design, start);
    if (nearer.log_posterior > now.log_posterior) now = std::move(nearer);
  }
  now = climbed(session, design, std::move(now));
  constexpr double times[] = {0.25, 0.5, 2, 4, 8, 16}, worth_it = 1;
  for (const Index k : uneven_sizes(session, design)) {
    std::optional<Optimum> higher;
    for (const double t : times) {
      Eigen::VectorXd x = now.x;
      x[k] *= t;
      Optimum there = judged_at(session, design, x);
      if (there.log_posterior > (higher ? *higher : now).log_posterior + worth_it) higher = std::move(there);
    }
    if (higher) now = climbed(session, design, std::move(*higher));
  }
  return now;
}

Optimum raised(const Session& session, const Design& design, const Optimum& optimum) {
  Optimum there = optimum;
  Fixed fixed;
  there.factor.compute(scored(session, design, there, fixed, For::new_terms).information);
  there.root.resize(there.eta.size());
  for (std::size_t c = 0; c < there.eta.size(); ++c) {
    if (!session.channels()[c]) continue;
    const ChannelRows& rows = *session.channels()[c];
    there.eta[c] = rows.raised(there.eta[c]);
    if (!rows.has_fixed_information()) there.root[c] = rows.information(there.eta[c]).cwiseSqrt();
  }
  return there;
}

namespace {

/// What the likelihood says of a block of coefficients with all others integrated, which have their priors.
Quadratic about(const Optimum& optimum, const Eigen::LLT<Eigen::MatrixXd>& factor, const Design& design,
                Index first, Index count) {
  const Index k = design.mean.size();
  const Eigen::MatrixXd covariance =
      factor.solve(Eigen::MatrixXd::Identity(k, k)).block(first, first, count, count);
  // Less the priors' own information, which is one in these units. Where counts bend the likelihood up, they
  // say nothing of a scale.
  const dense::SymmetricEigen own =
      dense::symmetric_eigen(covariance.inverse() - Eigen::MatrixXd::Identity(count, count));
  const Eigen::VectorXd known = own.values.cwiseMax(0.0),
                        at = own.vectors.transpose() * optimum.x.segment(first, count),
                        off = at - own.vectors.transpose() * design.mean.segment(first, count),
                        along = known.cwiseProduct(at) + (known.array() > 0).select(off, 0.0).matrix(),
                        scale = design.sigma.segment(first, count).cwiseInverse();
  Quadratic q;
  q.square =
      scale.asDiagonal() * (own.vectors * known.asDiagonal() * own.vectors.transpose()) * scale.asDiagonal();
  q.along = scale.cwiseProduct(own.vectors * along);
  return q;
}

/// The prior's factor that suits a term best, and what the integral over it adds to the evidence at the
/// present one.
struct Rescaled {
  double factor = 1, added = 0;
};
Rescaled rescaled(const Optimum& optimum, const Eigen::LLT<Eigen::MatrixXd>& factor, const Design& design,
                  const Design::Block& block, const Term& term) {
  if (block.sizes == 0) return {};
  const Quadratic q = about(optimum, factor, design, block.first, block.sizes);
  constexpr double farthest = 32;  // beyond that, what steps leave undone would grow to evidence
  const OverFactors over = integrate_over_factors(q, *term.kind, farthest * term.factor);
  return {over.factor, over.log_evidence - integrate(q, prior_of(*term.kind, term.factor)).log_evidence};
}

/// Laplace's approximation at the optimum; of shapes, a uniform prior instead of the normal one. Where a
/// shape hardly matters, its derivative says that it never does: a peak is not wider than the grid of its
/// starts says.
/// `log_fit`: at the optimum, with the priors of the first `base` coefficients, which are nuisances.
double log_evidence_of(const Optimum& optimum, const Eigen::LLT<Eigen::MatrixXd>& held, const Design& design,
                       const Eigen::MatrixXd& covariance, const std::vector<Term>& terms, double log_fit,
                       Index base) {
  double sum = optimum.log_posterior - 0.5 * log_determinant(held);
  const double of_uniform = 0.5 * std::log(2 * pi / 12);
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const Design::Block& block = design.blocks[t];
    sum += rescaled(optimum, held, design, block, terms[t]).added;
    const Index n = block.shapes, first = block.first_shape();
    const double width = n == 0 ? 0 : 0.5 * std::log(covariance.block(first, first, n, n).determinant());
    sum += std::min(terms[t].by_grid, width + static_cast<double>(n) * of_uniform + terms[t].by_modes);
  }
  // An average over what terms may come to: where the quadratic promises more than the best of it has with
  // all nuisances integrated out, it does not hold.
  const double best = log_fit - held.matrixLLT().diagonal().head(base).array().log().sum();
  return std::min(sum, best);
}

/// The term where its coefficients are; its shapes where a scoring step takes them, as far as the linear
/// model can be trusted.
Term moved(const Term& term, const Optimum& optimum, const Eigen::VectorXd& stepped, const Design& design,
           const Design::Block& block, const Eigen::MatrixXd& covariance) {
  Term there = term;
  const auto in_units = [&](Index first, Index count) {
    const Eigen::VectorXd s = design.sigma.segment(first, count);
    return Eigen::MatrixXd(s.asDiagonal() * covariance.block(first, first, count, count) * s.asDiagonal());
  };
  const Eigen::VectorXd size = design.sigma.segment(block.first, block.sizes)
                                   .cwiseProduct(optimum.x.segment(block.first, block.sizes));
  model::set_coefficients(there, size, in_units(block.first, block.sizes));
  const std::vector<std::size_t> shapes = model::refined_shapes_of(*term.kind);
  there.sigma.resize(there.values.size(), 0.0);
  for (Index j = 0; j < block.shapes; ++j) {
    const std::size_t k = shapes[static_cast<std::size_t>(j)];
    const Parameter& p = term.kind->mechanism->parameters[k];
    const Index at = block.first_shape() + j;
    const double span = p.logarithmic ? std::log(p.upper / p.lower) : p.upper - p.lower;
    const double unit = span / std::sqrt(12.0), by = std::clamp(stepped[at] * unit, -0.1 * span, 0.1 * span),
                 u = std::sqrt(covariance(at, at)) * unit;
    const double value = p.logarithmic ? term.values[k] * std::exp(by) : term.values[k] + by;
    there.values[k] = std::clamp(value, p.lower, p.upper);
    there.sigma[k] = p.logarithmic ? there.values[k] * std::min(2.0, u) : u;
  }
  return there;
}

/// A design in which shapes stay where they are.
Design with_shapes_held(Design design) {
  for (const Design::Block& block : design.blocks) {
    design.lower.segment(block.first_shape(), block.shapes).setZero();
    design.upper.segment(block.first_shape(), block.shapes).setZero();
  }
  return design;
}

/// Nuisances and sizes as they are known from fits before, everything else as its prior expects.
Eigen::VectorXd start_of(const Design& design, const std::vector<Term>& terms, const Eigen::VectorXd& base) {
  Eigen::VectorXd x = design.mean;
  x.head(base.size()) = base.cwiseQuotient(design.sigma.head(base.size()));
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const Design::Block& block = design.blocks[t];
    if (!terms[t].sigma.empty())  // else nobody has asked for its size
      x.segment(block.first, block.sizes) =
          model::coefficients(terms[t]).cwiseQuotient(design.sigma.segment(block.first, block.sizes));
  }
  return x;
}

/// One round of a fit: everything linear at its best, and a step of the shapes, whose effect the likelihood
/// does not count yet.
Fitted solved(const Session& session, std::vector<Term> terms, const Eigen::VectorXd& from) {
  Fitted result;
  result.design = design_of(session, terms);
  result.optimum = optimum_of(session, with_shapes_held(result.design), start_of(result.design, terms, from));
  Fixed fixed;
  const Scored there = scored(session, result.design, result.optimum, fixed, For::evidence);
  result.optimum.factor.compute(there.information);
  const Eigen::VectorXd stepped =
      within_bounds(result.design, result.optimum.x + step_of(there, result.design, result.optimum.x).by);
  Hypothesis& h = result.hypothesis;
  for (const Term& term : terms) h.log_prior += term.kind->log_prior;
  h.eta = result.optimum.eta;
  const Index base = session.count_base();
  const Eigen::VectorXd strain = result.optimum.x.head(base) - result.design.mean.head(base);
  h.log_fit = result.optimum.log_likelihood - 0.5 * strain.squaredNorm();
  h.base = result.design.sigma.head(base).cwiseProduct(result.optimum.x.head(base));
  const Index k = result.design.mean.size();
  const Eigen::MatrixXd covariance = result.optimum.factor.solve(Eigen::MatrixXd::Identity(k, k));
  Eigen::MatrixXd known = result.optimum.factor.reconstructedMatrix();
  hold_shapes(result.design, 1, known);
  const Eigen::LLT<Eigen::MatrixXd> held(known);
  h.log_evidence = log_evidence_of(result.optimum, held, result.design, covariance, terms, h.log_fit, base);
  for (std::size_t t = 0; t < terms.size(); ++t) {
    h.terms.push_back(
        moved(terms[t], result.optimum, stepped, result.design, result.design.blocks[t], covariance));
    h.terms.back().factor =
        rescaled(result.optimum, held, result.design, result.design.blocks[t], terms[t]).factor;
  }
  return result;
}

/// Sizes as found; shapes that share of the way from where they were to where the linear model has them.
std::vector<Term> part_of_way(const std::vector<Term>& from, const std::vector<Term>& to, double share) {
  std::vector<Term> list = to;
  for (std::size_t t = 0; t < list.size(); ++t)
    for (const std::size_t k : model::refined_shapes_of(*list[t].kind)) {
      const double a = from[t].values[k], b = to[t].values[k];
      list[t].values[k] = list[t].kind->mechanism->parameters[k].logarithmic ? a * std::pow(b / a, share)
                                                                             : a + share * (b - a);
    }
  return list;
}

}  // namespace

Fitted fit(const Session& session, const Hypothesis& hypothesis) {
  constexpr int most_rounds = 12;
  constexpr double settled = 0.1, shortest = 0.1;
  std::vector<Term> at = hypothesis.terms;
  for (Term& term : at)
    term.factor = std::max(1.0, term.factor);  // a narrow prior would hold sizes where they are
  Fitted best = solved(session, at, hypothesis.base);
  if (at.empty()) return best;
  // Deviations and factors suit the sizes only now.
  at = part_of_way(at, best.hypothesis.terms, 0);
  best = solved(session, at, best.hypothesis.base);
  for (int round = 1; round < most_rounds; ++round) {
    double share = 1;
    std::vector<Term> there = part_of_way(at, best.hypothesis.terms, share);
    Fitted next = solved(session, there, best.hypothesis.base);
    while (next.hypothesis.log_evidence < best.hypothesis.log_evidence - settled && share > shortest) {
      share /= 3;
      there = part_of_way(at, best.hypothesis.terms, share);
      next = solved(session, there, best.hypothesis.base);
    }
    const double gain = next.hypothesis.log_evidence - best.hypothesis.log_evidence;
    if (gain < -settled) {  // No step from here: they stay.
      best.hypothesis.terms = part_of_way(at, best.hypothesis.terms, 0);
      break;
    }
    best = std::move(next);
    at = std::move(there);
    if (gain < settled) break;
  }
  return best;
}

}  // namespace fit::explain::inference
