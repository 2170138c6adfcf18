// SPDX-License-Identifier: MIT
#include "fit/explain/inference/optimum.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

namespace fit::explain::inference {

using Eigen::Index;

namespace {

Eigen::VectorXd predictor(const Design::Part& part, const Eigen::VectorXd& x) {
  Eigen::VectorXd eta = part.offset;
  part.add(part.columns, x, eta);
  return eta;
}

/// Gradient and information of the posterior there.
struct Scored {
  Eigen::VectorXd gradient;
  Eigen::MatrixXd information;
};

/// What a quadratic approximation is for.
enum class For {
  steps,       ///< From there, however far.
  last_steps,  ///< From there, where the likelihood is as it curves there.
  evidence,    ///< Of what is there.
  new_terms    ///< Linearised at as much as the rows are on the whole.
};
Scored scored(const Session& session, const Design& design, Optimum& there, For what) {
  const bool for_new = what == For::new_terms, steps = what == For::steps || what == For::last_steps;
  const Index k = design.mean.size();
  Scored s{design.mean - there.x, Eigen::MatrixXd::Identity(k, k)};
  there.white.assign(design.parts.size(), {});
  there.white_residual.assign(design.parts.size(), {});
  for (std::size_t c = 0; c < design.parts.size(); ++c) {
    if (!session.channels()[c] || (steps && design.parts[c].index.empty())) continue;
    const ChannelRows& rows = *session.channels()[c];
    const std::vector<Index>& index = design.parts[c].index;
    if (const auto& fixed = design.parts[c].fixed) {
      s.gradient(index) += there.along[c];
      s.information(index, index) += fixed->square;
      if (steps) continue;
      there.white_residual[c] = rows.white_residual(there.eta[c]);
      there.white[c] = fixed->white;
      continue;
    }
    const Eigen::VectorXd eta = for_new ? rows.feasible(there.eta[c]) : there.eta[c];
    const Eigen::VectorXd at = for_new                   ? rows.expansion_for_new_terms(eta)
                               : what == For::steps      ? rows.expansion_for_steps(eta)
                               : what == For::last_steps ? rows.expansion_for_last_steps(eta)
                                                         : rows.expansion_for_evidence(eta);
    Squared columns = squared(rows.whitened(design.parts[c].columns, at));
    there.white_residual[c] = rows.white_residual(for_new ? at : eta);
    if (for_new)
      there.white_residual[c] += rows.whitened(at - eta, at);
    else if (at != eta)  // the same score over another root of the information
      there.white_residual[c] = there.white_residual[c].cwiseProduct(
          rows.information(eta).cwiseQuotient(rows.information(at)).cwiseSqrt());
    s.gradient(index) += columns.white.transpose() * there.white_residual[c];
    s.information(index, index) += columns.square;
    if (!steps) there.white[c] = std::move(columns.white);
  }
  return s;
}

using Stopped = std::vector<char>;  // By coefficient.

/// A step of those that are not stopped; the others go as `by` has it.
Eigen::VectorXd step_of_free(const Eigen::MatrixXd& information, const Eigen::VectorXd& gradient,
                             const Stopped& stopped, const Eigen::VectorXd& by) {
  Eigen::MatrixXd free = information;
  Eigen::VectorXd along = gradient;
  for (Index k = 0; k < by.size(); ++k)
    if (stopped[static_cast<std::size_t>(k)]) along -= information.col(k) * by[k];
  for (Index k = 0; k < by.size(); ++k) {
    if (!stopped[static_cast<std::size_t>(k)]) continue;
    free.row(k).setZero();
    free.col(k).setZero();
    free(k, k) = 1;
    along[k] = by[k];
  }
  return free.llt().solve(along);
}

/// Of those that a step takes over their bounds, only as far. Returns whether there are any.
bool stop_at_bounds(const Design& design, const Eigen::VectorXd& x, Stopped& stopped, Eigen::VectorXd& by) {
  bool any = false;
  for (Index k = 0; k < x.size(); ++k) {
    const double to = x[k] + by[k];
    if (stopped[static_cast<std::size_t>(k)] || (to >= design.lower[k] && to <= design.upper[k])) continue;
    by[k] = std::clamp(to, design.lower[k], design.upper[k]) - x[k];
    stopped[static_cast<std::size_t>(k)] = any = true;
  }
  return any;
}

/// A step of all coefficients that are not held at their bound, shortened by a damping (Levenberg and
/// Marquardt): where bounds stop some, the others go as far as suits those. And by how much the quadratic
/// approximation says that it gains.
struct Step {
  Eigen::VectorXd by;
  double promises = 0;
};
Step step_of(const Scored& s, const Design& design, const Eigen::VectorXd& x, double damping = 0) {
  constexpr int most_rounds = 8;
  Eigen::MatrixXd information = s.information;
  information.diagonal() *= 1 + damping;
  Stopped stopped(static_cast<std::size_t>(x.size()));
  for (Index k = 0; k < x.size(); ++k)
    stopped[static_cast<std::size_t>(k)] =
        (x[k] <= design.lower[k] && s.gradient[k] <= 0) || (x[k] >= design.upper[k] && s.gradient[k] >= 0);
  const Eigen::VectorXd first =
      step_of_free(information, s.gradient, stopped, Eigen::VectorXd::Zero(x.size()));
  Eigen::VectorXd by = first;
  for (int round = 1; round < most_rounds && stop_at_bounds(design, x, stopped, by); ++round)
    by = step_of_free(information, s.gradient, stopped, by);
  const auto gain = [&](const Eigen::VectorXd& d) { return d.dot(s.gradient - 0.5 * (information * d)); };
  // What was stopped on the way may have to come back: then the plain step.
  const double promises = gain(by);
  return promises > 0 ? Step{by, promises} : Step{first, gain(first)};
}

Eigen::VectorXd within_bounds(const Design& design, const Eigen::VectorXd& x) {
  return x.cwiseMax(design.lower).cwiseMin(design.upper);
}

void sum_up(const Design& design, Optimum& there) {
  there.log_likelihood = std::accumulate(there.of_channel.begin(), there.of_channel.end(), 0.0);
  there.log_posterior = there.log_likelihood - 0.5 * (there.x - design.mean).squaredNorm();
}

/// With the log of the posterior density there, up to a constant of the priors. `before`: anywhere else in
/// the same design, or null; channels without columns are there as they are here. Where the information is
/// fixed, the log-likelihood is a parabola about that, and the predictor is left out.
Optimum judged_at(const Session& session, const Design& design, const Eigen::VectorXd& x,
                  const Optimum* before) {
  Optimum there;
  there.x = within_bounds(design, x);
  for (std::size_t c = 0; c < design.parts.size(); ++c) {
    if (before && design.parts[c].index.empty()) {
      there.eta.push_back(before->eta[c]);
      there.along.push_back(before->along[c]);
      there.of_channel.push_back(before->of_channel[c]);
      continue;
    }
    const auto& fixed = design.parts[c].fixed;
    if (before && fixed) {
      const Eigen::VectorXd by = (there.x - before->x)(design.parts[c].index), change = fixed->square * by;
      there.eta.emplace_back();
      there.along.push_back(before->along[c] - change);
      there.of_channel.push_back(before->of_channel[c] + by.dot(before->along[c] - 0.5 * change));
      continue;
    }
    const auto& rows = session.channels()[c];
    there.eta.push_back(rows ? predictor(design.parts[c], there.x) : Eigen::VectorXd());
    there.along.push_back(fixed
                              ? Eigen::VectorXd(fixed->white.transpose() * rows->white_residual(there.eta[c]))
                              : Eigen::VectorXd());
    there.of_channel.push_back(rows ? rows->log_likelihood(there.eta[c]) : 0);
  }
  sum_up(design, there);
  return there;
}

/// With the predictors that were left out.
Optimum completed(const Session& session, const Design& design, Optimum there) {
  for (std::size_t c = 0; c < design.parts.size(); ++c) {
    if (!design.parts[c].fixed || design.parts[c].index.empty()) continue;
    there.eta[c] = predictor(design.parts[c], there.x);
    there.of_channel[c] = session.channels()[c]->log_likelihood(there.eta[c]);
  }
  sum_up(design, there);
  return there;
}

/// Uphill from there: by scoring steps, and near the top by steps of the observed information (Newton's),
/// which settle sooner, where they help.
Optimum climbed(const Session& session, const Design& design, Optimum now) {
  constexpr int most_steps = 40, most_idle = 2;
  constexpr double settled = 1e-3, near = 10, hardly = 3e-3, first_damping = 0.3, most_damping = 1e4;
  double damping = 0;
  For what = For::steps;
  int idle = 0;
  Scored s = scored(session, design, now, what);
  for (int step = 0; step < most_steps; ++step) {
    const Step whole = step_of(s, design, now.x, damping);
    if (whole.promises < settled) break;
    Optimum next = judged_at(session, design, now.x + whole.by, &now);
    if (what == For::last_steps && !(next.log_posterior >= now.log_posterior)) {
      what = For::steps;
      s = scored(session, design, now, what);
      continue;
    }
    while (next.log_posterior < now.log_posterior && damping < most_damping) {
      damping = std::max(first_damping, 8 * damping);
      next = judged_at(session, design, now.x + step_of(s, design, now.x, damping).by, &now);
    }
    if (next.log_posterior < now.log_posterior) break;
    damping = damping > first_damping ? damping / 8 : 0;
    const double gain = next.log_posterior - now.log_posterior;
    now = std::move(next);
    idle = gain < hardly ? idle + 1 : 0;
    what = gain < near ? For::last_steps : For::steps;
    s = scored(session, design, now, what);
    if (idle == most_idle) break;
  }
  now.factor.compute(s.information);
  return now;
}

/// Sizes that have a sign (variances, hazards) and act where the information depends on where it is: there a
/// likelihood may be flat and rise again farther on.
std::vector<Index> uneven_sizes(const Session& session, const Design& design) {
  std::vector<Index> list;
  for (const Design::Block& block : design.blocks)
    for (Index k = block.first; k < block.first_shape(); ++k)
      if (design.lower[k] == 0 && acts_unevenly(session, design, k)) list.push_back(k);
  return list;
}

}  // namespace

bool acts_unevenly(const Session& session, const Design& design, Index coefficient) {
  for (std::size_t c = 0; c < design.parts.size(); ++c) {
    const auto& rows = session.channels()[c];
    if (!rows || rows->has_fixed_information()) continue;
    const std::vector<Index>& index = design.parts[c].index;
    const auto at = std::ranges::find(index, coefficient);
    if (at != index.end() && !design.parts[c].columns.col(at - index.begin()).isZero()) return true;
  }
  return false;
}

Optimum optimum_of(const Session& session, const Design& design, const Eigen::VectorXd& start) {
  Optimum now = judged_at(session, design, design.mean, nullptr);
  if (start != design.mean) {
    Optimum nearer = judged_at(session, design, start, &now);
    if (nearer.log_posterior > now.log_posterior) now = std::move(nearer);
  }
  now = climbed(session, design, std::move(now));
  constexpr double times[] = {0.25, 0.5, 2, 4}, of_usual[] = {0.01, 0.1, 1}, worth_it = 1;
  for (const Index k : uneven_sizes(session, design)) {
    std::optional<Optimum> higher;
    const auto look_at = [&](double size) {
      Eigen::VectorXd x = now.x;
      x[k] = size;
      Optimum there = judged_at(session, design, x, &now);
      if (there.log_posterior > (higher ? *higher : now).log_posterior + worth_it) higher = std::move(there);
    };
    for (const double t : times) look_at(t * now.x[k]);
    for (const double size : of_usual) look_at(size);
    if (higher) now = climbed(session, design, std::move(*higher));
  }
  return completed(session, design, std::move(now));
}

Optimum expanded_for_new_terms(const Session& session, const Design& design, const Optimum& optimum) {
  Optimum there = optimum;
  there.factor.compute(scored(session, design, there, For::new_terms).information);
  there.root.resize(there.eta.size());
  for (std::size_t c = 0; c < there.eta.size(); ++c) {
    if (!session.channels()[c]) continue;
    const ChannelRows& rows = *session.channels()[c];
    there.eta[c] = rows.expansion_for_new_terms(there.eta[c]);
    if (!rows.has_fixed_information()) there.root[c] = rows.information(there.eta[c]).cwiseSqrt();
  }
  return there;
}

Eigen::VectorXd curvature_at(const Session& session, const Design& design, Optimum& there) {
  const Scored s = scored(session, design, there, For::evidence);
  there.factor.compute(s.information);
  return within_bounds(design, there.x + step_of(s, design, there.x).by);
}

}  // namespace fit::explain::inference
