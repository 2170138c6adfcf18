// SPDX-License-Identifier: MIT
#include "fit/explain/inference/approximation.hpp"

#include <algorithm>
#include <cmath>

namespace fit::explain::inference {

using Eigen::Index;

std::vector<Eigen::MatrixXd> Approximation::whitened(std::vector<Eigen::MatrixXd> columns) const {
  for (std::size_t c = 0; c < columns.size(); ++c)
    if (columns[c].cols() > 0)
      columns[c] = session_->channels()[c]->whitened(std::move(columns[c]), around_->eta[c]);
  return columns;
}

std::vector<Eigen::MatrixXd> Approximation::whitened_at(std::size_t start) const {
  const std::vector<Eigen::MatrixXf>& columns = session_->at_start(*kind_, start).columns;
  std::vector<Eigen::MatrixXd> white(columns.size());
  for (std::size_t c = 0; c < columns.size(); ++c) {
    white[c] = columns[c].cast<double>();
    if (white[c].cols() > 0 && around_->root[c].size() > 0)
      white[c] = around_->root[c].asDiagonal() * white[c];
  }
  return white;
}

Quadratic Approximation::projected(const std::vector<Eigen::MatrixXd>& columns) const {
  Index k = 0;
  for (const auto& c : columns) k = std::max(k, c.cols());
  Quadratic q{Eigen::MatrixXd::Zero(k, k), Eigen::VectorXd::Zero(k)};
  Eigen::MatrixXd cross = Eigen::MatrixXd::Zero(fitted_->design.mean.size(), k);
  for (std::size_t c = 0; c < columns.size(); ++c) {
    if (columns[c].cols() == 0) continue;
    const Eigen::MatrixXd& white = columns[c];
    const Index n = white.cols();
    q.square.topLeftCorner(n, n).noalias() += white.transpose() * white;
    q.along.head(n).noalias() += white.transpose() * around_->white_residual[c];
    const Eigen::MatrixXd with = around_->white[c].transpose() * white;
    const auto& index = fitted_->design.parts[c].index;
    for (std::size_t i = 0; i < index.size(); ++i)
      cross.row(index[i]).head(n) += with.row(static_cast<Index>(i));
  }
  q.square -= cross.transpose() * around_->factor.solve(cross);
  return q;
}

std::vector<Eigen::MatrixXd> Approximation::columns_of(const Term& term) const {
  std::vector<Eigen::MatrixXd> columns(session_->channels().size());
  for (std::size_t c = 0; c < columns.size(); ++c)
    if (kind_->acts_in[c])
      columns[c] = model::columns_of(*session_->channels()[c], *kind_, term.values, &kind_->acts_in[c]);
  return columns;
}

double Approximation::with_sizes(Term& term, std::optional<std::size_t> start) const {
  const double without_size = kind_->acts_without_size ? gain_of_offset(term, start) : 0;
  if (kind_->coefficients.empty()) return without_size;
  const OverFactors over =
      integrate_over_factors(projected(start ? whitened_at(*start) : whitened(columns_of(term))), *kind_);
  if (!over.best.value.allFinite()) return -1e300;
  model::set_coefficients(term, over.best.value, over.best.covariance);
  term.factor = over.factor;
  return without_size + over.log_evidence;
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
                          deviations = model::deviation_columns(rows, term);
    shapes = places.cols();
    columns[c].resize(rows.rows(), sizes.cols() + places.cols() + deviations.cols());
    columns[c] << sizes, places, deviations;
  }
  const double all = without_size +
                     integrate_over_factors(projected(whitened(std::move(columns))), *kind_).log_evidence +
                     static_cast<double>(shapes) * 0.5 * std::log(2 * pi / 12);
  return std::isfinite(all) ? all : -1e300;
}

double Approximation::gain_of_offset(const Term& term, std::optional<std::size_t> start) const {
  double sum = 0;
  for (std::size_t c = 0; c < session_->channels().size(); ++c) {
    if (!kind_->acts_in[c].without_size) continue;
    const ChannelRows& rows = *session_->channels()[c];
    const Eigen::VectorXd offset =
        start ? session_->at_start(*kind_, *start).without_size[c].cast<double>().eval()
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
