// SPDX-License-Identifier: MIT
#include "fit/explain/intensity/model.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace fit::explain::intensity {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

void Block::add(const MatrixXd& more, double sigma_of_more) {
  const Index before = columns.cols();
  columns.conservativeResize(more.rows(), before + more.cols());
  columns.rightCols(more.cols()) = more;
  sigma.conservativeResize(before + more.cols());
  sigma.tail(more.cols()).setConstant(sigma_of_more);
}

void Block::add(const Block& more) {
  for (Index k = 0; k < more.columns.cols(); ++k) add(more.columns.col(k), more.sigma[k]);
}

Model::Model(const VectorXd& deviations, VectorXd weight, const Block& base)
    : weight_(std::move(weight)), white_(weight_.cwiseProduct(deviations)), sigma_(base.sigma) {
  base_ = weight_.asDiagonal() * base.columns * base.sigma.asDiagonal();
  MatrixXd normal = base_.transpose() * base_;
  normal.diagonal().array() += 1;
  factor_.compute(normal);
  along_ = base_.transpose() * white_;
  rest_ = white_ - base_ * factor_.solve(along_);
}

VectorXd Model::coefficients() const { return sigma_.cwiseProduct(factor_.solve(along_)); }

VectorXd Model::uncertainties() const {
  const MatrixXd inverse = factor_.solve(MatrixXd::Identity(base_.cols(), base_.cols()));
  return sigma_.cwiseProduct(inverse.diagonal().cwiseSqrt());
}

VectorXd Model::left_of(const VectorXd& effect) const {
  const VectorXd white = weight_.cwiseProduct(effect);
  return white - base_ * factor_.solve(base_.transpose() * white);
}

MeanModel::Products Model::products(const MatrixXd& columns) const {
  const MatrixXd white = weight_.asDiagonal() * columns;
  const MatrixXd cross = base_.transpose() * white;
  return {white.transpose() * white - cross.transpose() * factor_.solve(cross), white.transpose() * rest_};
}

double Model::gain(const VectorXd& effect) const {
  const VectorXd white = weight_.cwiseProduct(effect), taken = base_.transpose() * white;
  return white.dot(rest_) - 0.5 * (white.squaredNorm() - taken.dot(factor_.solve(taken)));
}

Model::HeldOut Model::held_out(const std::vector<int>& part_of_row, int parts) const {
  const Index k = base_.cols();
  std::vector<MatrixXd> square(static_cast<std::size_t>(parts), MatrixXd::Zero(k, k));
  std::vector<VectorXd> along(static_cast<std::size_t>(parts), VectorXd::Zero(k));
  for (Index i = 0; i < base_.rows(); ++i) {
    const auto p = static_cast<std::size_t>(part_of_row[static_cast<std::size_t>(i)]);
    square[p] += base_.row(i).transpose() * base_.row(i);
    along[p] += base_.row(i).transpose() * white_[i];
  }
  MatrixXd all = MatrixXd::Identity(k, k);
  VectorXd sum = VectorXd::Zero(k);
  for (std::size_t p = 0; p < square.size(); ++p) {
    all += square[p];
    sum += along[p];
  }
  HeldOut held;
  double squares = 0;
  for (int part = 0; part < parts; ++part) {
    const auto p = static_cast<std::size_t>(part);
    const VectorXd x = MatrixXd(all - square[p]).llt().solve(sum - along[p]);
    for (Index i = 0; i < base_.rows(); ++i) {
      if (part_of_row[static_cast<std::size_t>(i)] != part) continue;
      const double z = white_[i] - (k > 0 ? base_.row(i).dot(x) : 0.0);
      held.log_likelihood -= 0.5 * z * z;
      squares += std::pow(z / weight_[i], 2);
    }
  }
  held.rms = std::sqrt(squares / std::max<double>(1, static_cast<double>(base_.rows())));
  return held;
}

}  // namespace fit::explain::intensity
