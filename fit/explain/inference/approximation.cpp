// SPDX-License-Identifier: MIT
#include "fit/explain/inference/approximation.hpp"

#include <algorithm>
#include <cmath>

#include "fit/numeric/products.hpp"

namespace fit::explain::inference {

using Eigen::Index;

std::vector<Eigen::MatrixXd> whitened_around(const Session& session, const Optimum& around,
                                             std::vector<Eigen::MatrixXd> columns) {
  for (std::size_t c = 0; c < columns.size(); ++c)
    if (columns[c].cols() > 0)
      columns[c] = session.channels()[c]->whitened(std::move(columns[c]), around.eta[c]);
  return columns;
}

std::vector<Quadratic> Approximation::projected_at(std::size_t first, std::size_t count) const {
  std::vector<const std::vector<Session::AtStart>*> starts;
  for (std::size_t i = first; i < first + count; ++i) starts.push_back(&session_->at_start(*kind_, i));
  std::vector<Eigen::MatrixXd> white(session_->channels().size());
  for (std::size_t c = 0; c < white.size(); ++c)
    for (std::size_t i = 0; i < count; ++i) {
      const Eigen::MatrixXf& columns = (*starts[i])[c].columns;
      const Index n = columns.cols();
      if (n == 0) break;
      if (i == 0) white[c].resize(columns.rows(), static_cast<Index>(count) * n);
      auto here = white[c].middleCols(static_cast<Index>(i) * n, n);
      here = columns.cast<double>();
      if (around_->root[c].size() > 0) here.array().colwise() *= around_->root[c].array();
    }
  return projected(*fitted_, *around_, white, count, starts);
}

std::vector<Quadratic> projected(const Fitted& fitted, const Optimum& around,
                                 const std::vector<Eigen::MatrixXd>& columns, std::size_t count,
                                 std::span<const std::vector<Session::AtStart>* const> starts) {
  const auto terms = static_cast<Index>(count);
  Index k = 0;
  for (const auto& c : columns) k = std::max(k, c.cols() / terms);
  std::vector<Quadratic> list(count, {Eigen::MatrixXd::Zero(k, k), Eigen::VectorXd::Zero(k)});
  Eigen::MatrixXd cross = Eigen::MatrixXd::Zero(fitted.design.mean.size(), terms * k);
  for (std::size_t c = 0; c < columns.size(); ++c) {
    if (columns[c].cols() == 0) continue;
    const Index n = columns[c].cols() / terms;
    const bool is_known = !starts.empty() && (*starts.front())[c].with_base.size() > 0;
    const Index known = is_known ? (*starts.front())[c].with_base.rows() : 0,
                others = around.white[c].cols() - known;  // the base comes first
    Eigen::MatrixXd with(known + others, columns[c].cols());
    with.bottomRows(others) = transpose_product(around.white[c].rightCols(others), columns[c]);
    const Eigen::VectorXd along = columns[c].transpose() * around.white_residual[c];
    const auto& index = fitted.design.parts[c].index;
    for (Index t = 0; t < terms; ++t) {
      const Session::AtStart* at = is_known ? &(*starts[static_cast<std::size_t>(t)])[c] : nullptr;
      if (at) with.block(0, t * n, known, n) = at->with_base;
      Quadratic& q = list[static_cast<std::size_t>(t)];
      q.square.topLeftCorner(n, n) += at ? at->square : square_of_columns(columns[c].middleCols(t * n, n));
      q.along.head(n) += along.segment(t * n, n);
      cross(index, Eigen::seqN(t * k, n)) += with.middleCols(t * n, n);
    }
  }
  const Eigen::MatrixXd solved = around.factor.solve(cross);
  for (Index t = 0; t < terms; ++t)
    list[static_cast<std::size_t>(t)].square -=
        cross.middleCols(t * k, k).transpose() * solved.middleCols(t * k, k);
  return list;
}

std::vector<Eigen::MatrixXd> Approximation::columns_of(const Term& term) const {
  std::vector<Eigen::MatrixXd> columns(session_->channels().size());
  for (std::size_t c = 0; c < columns.size(); ++c)
    if (kind_->acts_in[c])
      columns[c] = model::columns_of(*session_->channels()[c], *kind_, term.values, &kind_->acts_in[c]);
  return columns;
}

Quadratic Approximation::projected_columns(std::vector<Eigen::MatrixXd> columns) const {
  return projected(*fitted_, *around_, whitened_around(*session_, *around_, std::move(columns))).front();
}

double Approximation::with_sizes(Term& term, const Quadratic& likelihood, double without_size) const {
  const OverFactors over = integrate_over_factors(likelihood, *kind_);
  if (!over.best.value.allFinite()) return -1e300;
  model::set_coefficients(term, over.best.value, over.best.covariance);
  term.factor = over.factor;
  return without_size + over.log_evidence;
}

double Approximation::with_sizes(Term& term) const {
  const double without_size = kind_->acts_without_size ? gain_of_offset(term) : 0;
  if (kind_->coefficients.empty()) return without_size;
  return with_sizes(term, projected_columns(columns_of(term)), without_size);
}

std::vector<double> Approximation::with_sizes_at_starts(std::vector<Term>& terms) const {
  constexpr std::size_t together = 16;  // whose columns a cache holds
  std::vector<double> logs(terms.size(), 0.0);
  for (std::size_t i = 0; i < terms.size(); ++i)
    if (kind_->acts_without_size) logs[i] = gain_of_offset(terms[i], i);
  for (std::size_t first = 0; first < terms.size() && !kind_->coefficients.empty(); first += together) {
    const std::size_t count = std::min(together, terms.size() - first);
    const std::vector<Quadratic> each = projected_at(first, count);
    for (std::size_t i = 0; i < count; ++i)
      logs[first + i] = with_sizes(terms[first + i], each[i], logs[first + i]);
  }
  return logs;
}

double Approximation::with_everything(const Term& term, bool with_shapes) const {
  const double without_size = kind_->acts_without_size ? gain_of_offset(term) : 0;
  if (kind_->coefficients.empty()) return without_size + (with_shapes ? width_without_sizes(term) : 0);
  std::vector<Eigen::MatrixXd> columns(session_->channels().size());
  Index shapes = 0;
  for (std::size_t c = 0; c < columns.size(); ++c) {
    if (!kind_->acts_in[c]) continue;
    const ChannelRows& rows = *session_->channels()[c];
    const Eigen::MatrixXd sizes = model::columns_of(rows, *kind_, term.values, &kind_->acts_in[c]),
                          places = with_shapes ? model::shape_columns(rows, term)
                                               : Eigen::MatrixXd(rows.rows(), 0),
                          deviations = model::deviations_of(rows, term).columns;
    shapes = places.cols();
    columns[c].resize(rows.rows(), sizes.cols() + places.cols() + deviations.cols());
    columns[c] << sizes, places, deviations;
  }
  const double all = without_size +
                     integrate_over_factors(projected_columns(std::move(columns)), *kind_).log_evidence +
                     static_cast<double>(shapes) * 0.5 * std::log(2 * pi / 12);
  return std::isfinite(all) ? all : -1e300;
}

std::vector<model::RowScore> Approximation::scores_alone() const {
  std::vector<double> everywhere = kind_->starts.front();
  const double size = everywhere.front();
  everywhere[everywhere.size() - 2] = -1e300;
  everywhere.back() = 1e300;
  std::vector<model::RowScore> scores;
  for (std::size_t c = 0; c < session_->channels().size(); ++c) {
    if (!kind_->acts_in[c]) continue;
    const ChannelRows& rows = *session_->channels()[c];
    const Eigen::VectorXd information = rows.information(around_->eta[c]),
                          score = rows.score_alone(around_->eta[c]),
                          each = model::effect_of(rows, *kind_, everywhere) / size;
    for (Index i = 0; i < rows.rows(); ++i)
      scores.push_back({model::place_of(kind_->mechanism->coordinate, kind_->target, rows.at(i)),
                        each[i] * score[i], each[i] * each[i] * information[i]});
  }
  return scores;
}

std::vector<double> Approximation::recorded_places() const {
  std::vector<double> places;
  for (std::size_t c = 0; c < session_->channels().size(); ++c) {
    if (!kind_->acts_in[c]) continue;
    const ChannelRows& rows = *session_->channels()[c];
    for (Index i = 0; i < rows.rows(); ++i) {
      const double place = model::place_of(kind_->mechanism->coordinate, kind_->target, rows.at(i));
      if (!std::isfinite(place)) continue;
      const std::span<const model::CellOfRow> cells = rows.cells_of(i);
      if (kind_->differs_within_rows() && !cells.empty())
        for (const model::CellOfRow& cell : cells) places.push_back(cell.along_mm);
      else
        places.push_back(place);
    }
  }
  return places;
}

double Approximation::gain_of_offset(const Term& term, std::optional<std::size_t> start) const {
  double sum = 0;
  for (std::size_t c = 0; c < session_->channels().size(); ++c) {
    if (!kind_->acts_in[c].without_size) continue;
    const ChannelRows& rows = *session_->channels()[c];
    const Eigen::VectorXd offset =
        start ? session_->at_start(*kind_, *start)[c].without_size.cast<double>().eval()
              : model::effect_without_size(rows, *kind_, term.values);
    if (offset.size() > 0 && !offset.isZero(0))
      sum += rows.log_likelihood(fitted_->optimum.eta[c] + offset) - fitted_->optimum.of_channel[c];
  }
  return sum;
}

double Approximation::width_without_sizes(const Term& term) const {
  double sum = 0;
  Eigen::MatrixXd square;
  for (std::size_t c = 0; c < session_->channels().size(); ++c) {
    if (!kind_->acts_in[c]) continue;
    const ChannelRows& rows = *session_->channels()[c];
    const Eigen::MatrixXd white =
        rows.whitened(model::shape_columns(rows, term),
                      fitted_->optimum.eta[c] + model::effect_of(rows, *kind_, term.values));
    if (square.size() == 0) square = Eigen::MatrixXd::Identity(white.cols(), white.cols());
    square += white.transpose() * white;
  }
  if (square.size() > 0)
    sum = -0.5 * std::log(square.determinant()) +
          static_cast<double>(square.rows()) * 0.5 * std::log(2 * pi / 12);
  return sum;
}

}  // namespace fit::explain::inference
