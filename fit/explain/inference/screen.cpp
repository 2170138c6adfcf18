// SPDX-License-Identifier: MIT
#include "fit/explain/inference/screen.hpp"

#include <nlopt.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "fit/explain/search/two_cores.hpp"

namespace fit::explain::inference {
namespace {

using Eigen::Index;

/// Asks what one kind would add, by the quadratic approximation at the fitted hypothesis.
class Question {
 public:
  Question(const Session& session, const Fitted& fitted, const Kind& kind)
      : session_(session), fitted_(fitted), kind_(kind) {}

  Candidate answer() const {
    struct Asked {
      double log_evidence;
      Term term;
    };
    std::vector<Asked> asked;
    for (const auto& start : kind_.starts) {
      Term term = term_at(start);
      const double log_evidence = with_sizes(term);
      asked.push_back({log_evidence, std::move(term)});
    }
    std::vector<double> logs;
    for (const Asked& one : asked) logs.push_back(one.log_evidence);
    const double over_grid = log_sum(logs) - std::log(static_cast<double>(logs.size()));
    std::ranges::sort(asked, [](const Asked& a, const Asked& b) { return a.log_evidence > b.log_evidence; });
    Candidate best;
    best.term = asked.front().term;
    const bool shows = asked.front().log_evidence > least_to_refine;
    const bool refines = kind_.refines && !model::shapes_of(kind_).empty();
    if (!refines || !shows) {
      best.term.other_places = refines ? 0 : over_grid - asked.front().log_evidence;
      best.log_evidence = shows && !kind_.is_form() ? with_everything(best.term) + best.term.other_places : over_grid;
      return best;
    }
    std::vector<double> modes;
    for (std::size_t m = 0; m < std::min<std::size_t>(2, asked.size()); ++m) {
      if (asked[m].log_evidence < asked.front().log_evidence - 8) continue;
      const Term there = refined(asked[m].term);
      const double of_mode = with_everything(there);
      modes.push_back(of_mode);
      if (of_mode <= best.log_evidence) continue;
      best.log_evidence = of_mode;
      best.term = there;
    }
    // All places are paid for: by the width of the best ones, or by the mean over the grid where that is more.
    const double all = std::max(log_sum(modes), over_grid);
    best.term.other_places = all - best.log_evidence;
    best.log_evidence = all;
    return best;
  }

 private:
  static constexpr double least_to_refine = 1;

  [[nodiscard]] Term term_at(const std::vector<double>& values) const {
    Term term;
    term.kind = &kind_;
    term.values = values;
    return term;
  }

  /// With the base and present terms integrated out.
  [[nodiscard]] Quadratic projected(const std::vector<Eigen::MatrixXd>& columns) const {
    Index k = 0;
    for (const auto& c : columns) k = std::max(k, c.cols());
    Quadratic q{Eigen::MatrixXd::Zero(k, k), Eigen::VectorXd::Zero(k)};
    Eigen::MatrixXd cross = Eigen::MatrixXd::Zero(fitted_.design.mean.size(), k);
    for (std::size_t c = 0; c < columns.size(); ++c) {
      if (columns[c].cols() == 0) continue;
      const Eigen::MatrixXd white = session_.channels()[c]->whitened(columns[c], fitted_.optimum.eta[c]);
      q.square += white.transpose() * white;
      q.along += white.transpose() * fitted_.optimum.white_residual[c];
      const Eigen::MatrixXd with = fitted_.optimum.white[c].transpose() * white;
      const auto& index = fitted_.design.parts[c].index;
      for (std::size_t i = 0; i < index.size(); ++i) cross.row(index[i]) += with.row(static_cast<Index>(i));
    }
    q.square -= cross.transpose() * fitted_.optimum.factor.solve(cross);
    return q;
  }

  /// At those shapes, over all sizes; the term gets the best.
  double with_sizes(Term& term) const {
    if (kind_.coefficients.empty()) return gain_of_offset(term);
    std::vector<Eigen::MatrixXd> columns(session_.channels().size());
    for (std::size_t c = 0; c < columns.size(); ++c)
      if (kind_.acts_in[c]) columns[c] = model::columns_of(*session_.channels()[c], kind_, term.values);
    const OverFactors over = integrate_over_factors(projected(columns), kind_);
    if (!over.best.value.allFinite()) return -1e300;
    model::set_coefficients(term, over.best.value, over.best.covariance);
    term.factor = over.factor;
    return over.log_evidence;
  }

  /// With the width of its shapes, and the deviations that the formula allows.
  [[nodiscard]] double with_everything(const Term& term) const {
    if (kind_.coefficients.empty()) return gain_of_offset(term) + width_without_sizes(term);
    std::vector<Eigen::MatrixXd> columns(session_.channels().size());
    Index shapes = 0;
    for (std::size_t c = 0; c < columns.size(); ++c) {
      if (!kind_.acts_in[c]) continue;
      const ChannelRows& rows = *session_.channels()[c];
      const Eigen::MatrixXd sizes = model::columns_of(rows, kind_, term.values),
                            places = model::shape_columns(rows, term),
                            deviations = model::deviation_columns(rows, term);
      shapes = places.cols();
      columns[c].resize(rows.rows(), sizes.cols() + places.cols() + deviations.cols());
      columns[c] << sizes, places, deviations;
    }
    return integrate_over_factors(projected(columns), kind_).log_evidence +
           static_cast<double>(shapes) * 0.5 * std::log(2 * pi / 12);
  }

  [[nodiscard]] double gain_of_offset(const Term& term) const {
    double sum = 0;
    for (std::size_t c = 0; c < session_.channels().size(); ++c) {
      if (!kind_.acts_in[c]) continue;
      const ChannelRows& rows = *session_.channels()[c];
      const Eigen::VectorXd& eta = fitted_.optimum.eta[c];
      sum += rows.log_likelihood(eta + model::effect_of(rows, kind_, term.values)) - rows.log_likelihood(eta);
    }
    return sum;
  }

  [[nodiscard]] double width_without_sizes(const Term& term) const {
    double sum = 0;
    Eigen::MatrixXd square;
    for (std::size_t c = 0; c < session_.channels().size(); ++c) {
      if (!kind_.acts_in[c]) continue;
      const ChannelRows& rows = *session_.channels()[c];
      const Eigen::MatrixXd white = rows.whitened(
          model::shape_columns(rows, term),
          fitted_.optimum.eta[c] + model::effect_of(rows, kind_, term.values));
      if (square.size() == 0) square = Eigen::MatrixXd::Identity(white.cols(), white.cols());
      square += white.transpose() * white;
    }
    if (square.size() > 0)
      sum = -0.5 * std::log(square.determinant()) + static_cast<double>(square.rows()) * 0.5 * std::log(2 * pi / 12);
    return sum;
  }

  /// Shapes between those of the grid.
  [[nodiscard]] Term refined(const Term& start) const {
    const std::vector<std::size_t> shapes = model::shapes_of(kind_);
    const auto& parameters = kind_.mechanism->parameters;
    struct Context {
      const Question& question;
      const std::vector<std::size_t>& shapes;
      Term at, best;
      double most;
    } context{*this, shapes, start, start, -1e300};
    std::vector<double> x, lower, upper, first;
    for (const std::size_t k : shapes) {
      const Parameter& p = parameters[k];
      const auto in = [&](double v) { return p.logarithmic ? std::log(v) : v; };
      lower.push_back(in(p.lower));
      upper.push_back(in(p.upper));
      x.push_back(std::clamp(in(start.values[k]), lower.back(), upper.back()));
      first.push_back((upper.back() - lower.back()) / std::max(2, p.starts) / 2);
    }
    const auto count = static_cast<unsigned>(shapes.size());
    nlopt_opt optimiser = nlopt_create(NLOPT_LN_NELDERMEAD, count);
    nlopt_set_lower_bounds(optimiser, lower.data());
    nlopt_set_upper_bounds(optimiser, upper.data());
    nlopt_set_initial_step(optimiser, first.data());
    nlopt_set_maxeval(optimiser, 15 + 15 * static_cast<int>(count));
    nlopt_set_ftol_abs(optimiser, 0.02);
    nlopt_set_max_objective(
        optimiser,
        [](unsigned size, const double* at, double*, void* data) {
          auto& c = *static_cast<Context*>(data);
          for (unsigned i = 0; i < size; ++i)
            c.at.values[c.shapes[i]] =
                c.question.kind_.mechanism->parameters[c.shapes[i]].logarithmic ? std::exp(at[i]) : at[i];
          const double log_evidence = c.question.with_sizes(c.at);
          if (log_evidence > c.most) {
            c.most = log_evidence;
            c.best = c.at;
          }
          return log_evidence;
        },
        &context);
    double value = 0;
    nlopt_optimize(optimiser, x.data(), &value);
    nlopt_destroy(optimiser);
    return context.best;
  }

  const Session& session_;
  const Fitted& fitted_;
  const Kind& kind_;
};

}  // namespace

std::vector<Candidate> screen(const Session& session, const Fitted& fitted, const Kind* but) {
  std::vector<const Kind*> asked;
  for (const Kind& kind : session.kinds())
    if (!fitted.hypothesis.has(kind) && &kind != but) asked.push_back(&kind);
  std::ranges::stable_sort(asked, std::greater<>(), [](const Kind* kind) { return kind->starts.size(); });
  std::vector<Candidate> list(asked.size());
  search::on_two_cores(asked.size(),
                       [&](std::size_t i) { list[i] = Question(session, fitted, *asked[i]).answer(); });
  std::ranges::sort(list, [](const Candidate& a, const Candidate& b) { return a.log_posterior() > b.log_posterior(); });
  return list;
}

}  // namespace fit::explain::inference
