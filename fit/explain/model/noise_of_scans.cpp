// SPDX-License-Identifier: MIT
#include "fit/explain/model/noise_of_scans.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "fit/explain/model/autoregression.hpp"

namespace fit::explain::model {
namespace {

using Eigen::Index;

/// Share of beams' noise that is autoregressive with this correlation, by products of neighbouring scans'
/// deviations, from which what the whole scan has in common was taken; 0 unless that is certain.
double share_of_beams(const Reduced& reduced, double rho) {
  constexpr double certain = 3;  // standard errors
  constexpr int fewest_scans = 4;
  std::map<int, double> cells_of_length;
  double next = 0, squares = 0;  // products of neighbours, and of each with itself
  for (const Group& group : reduced.groups) {
    if (group.scans < fewest_scans || group.cells == 0 || !(group.lagged[0] > 0)) continue;
    const auto cells = static_cast<double>(group.cells);
    const double pairs = cells * (group.scans - 1.0);
    next += group.lagged[1] / group.lagged[0] * pairs;
    squares += pairs;
    cells_of_length[group.scans] += cells;
  }
  if (cells_of_length.empty()) return 0;
  LagSums white{}, with{};
  for (const auto& [scans, cells] : cells_of_length) {
    const LagSums of_white = lagged_of(scans, 0), autocorrelated = lagged_of(scans, rho);
    for (const std::size_t lag : {0, 1}) {
      white[lag] += cells * of_white[lag];
      with[lag] += cells * autocorrelated[lag];
    }
  }
  const double ratio = next / squares;
  if (ratio - white[1] / white[0] < certain / std::sqrt(squares)) return 0;
  // The share at which the mixed sums have that ratio.
  const double share = (white[1] - ratio * white[0]) / (ratio * (with[0] - white[0]) - (with[1] - white[1]));
  return std::clamp(share, 0.0, 1.0);
}

/// Numbers of the blocks, in the order in which they first occur.
std::map<int, Index> numbered_blocks(std::span<const ScanPart> parts) {
  std::map<int, Index> numbers;
  for (const ScanPart& part : parts) numbers.try_emplace(part.block, static_cast<Index>(numbers.size()));
  return numbers;
}

}  // namespace

RandomOfScans random_of_scans(const Reduced& reduced, const ScatterOfScans& scatter) {
  RandomOfScans random;
  if (scatter.share > 0) {
    random.rho = scatter.rho;
    const double autocorrelated = scatter.ratio * scatter.share;
    random.own = std::min({share_of_beams(reduced, scatter.rho), autocorrelated, 0.999});
    random.slow = (autocorrelated - random.own) * scatter.variance;
  }
  random.fresh = std::max(0.0, scatter.beside_samples() - random.slow);
  return random;
}

NoiseOfScans::NoiseOfScans(Index first, std::span<const ScanPart> parts, const RandomOfScans& range,
                           const RandomOfScans& angle)
    : first_(first), rows_(static_cast<Index>(parts.size())), weight_(rows_) {
  const std::map<int, Index> blocks = numbered_blocks(parts);
  const bool own = range.own > 0 || angle.own > 0;
  // The range, the angle, and what every block has of its own.
  const Index states = 2 + (own ? static_cast<Index>(blocks.size()) : 0);
  keeps_.resize(states);
  keeps_.head<2>() << range.rho, angle.rho;
  Eigen::VectorXd stationary(states);
  stationary.head<2>() << range.slow, angle.slow;
  Eigen::MatrixXd is_of_block = Eigen::MatrixXd::Zero(rows_, static_cast<Index>(blocks.size()));
  for (Index i = 0; i < rows_; ++i) {
    const ScanPart& part = parts[static_cast<std::size_t>(i)];
    const Index block = blocks.at(part.block);
    weight_[i] = 1 / std::sqrt(part.variance_mm2);
    is_of_block(i, block) = weight_[i];
    if (!own) continue;
    const RandomOfScans& of = part.of_angle ? angle : range;
    keeps_[2 + block] = of.rho;
    stationary[2 + block] = of.own;
  }
  Eigen::MatrixXd covariance = stationary.asDiagonal();
  const Eigen::Vector2d fresh(range.fresh, angle.fresh);
  for (Index at = 0, end = 0; at < rows_; at = end) {
    const int scan = parts[static_cast<std::size_t>(at)].in_capture;
    while (end < rows_ && parts[static_cast<std::size_t>(end)].in_capture == scan) ++end;
    Step step{at, end - at, Eigen::MatrixXd::Zero(end - at, states), {}, {}};
    Eigen::VectorXd alone = Eigen::VectorXd::Ones(end - at);
    for (Index i = at; i < end; ++i) {
      const ScanPart& part = parts[static_cast<std::size_t>(i)];
      step.sees.row(i - at).head<2>() =
          weight_[i] * Eigen::RowVector2d(part.of_angle ? 0 : 1, part.sensitivity_mm);
      if (!own) continue;
      step.sees(i - at, 2 + blocks.at(part.block)) = 1;
      alone[i - at] -= part.of_angle ? angle.own : range.own;
    }
    const auto shared = step.sees.leftCols<2>();
    Eigen::MatrixXd innovation = step.sees * covariance * step.sees.transpose();
    innovation += shared * fresh.asDiagonal() * shared.transpose();
    innovation.diagonal() += alone;
    step.root.compute(innovation);
    step.gain = step.root.solve(step.sees * covariance).transpose();
    covariance -= step.gain * step.sees * covariance;
    covariance = keeps_.asDiagonal() * covariance * keeps_.asDiagonal();
    covariance.diagonal() += (stationary.array() * (1 - keeps_.array().square())).matrix();
    steps_.push_back(std::move(step));
  }
  filter(is_of_block);
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(is_of_block);
  means_ = qr.householderQ() * Eigen::MatrixXd::Identity(rows_, qr.rank());
}

void NoiseOfScans::filter(Eigen::Ref<Eigen::MatrixXd> rows) const {
  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(keeps_.size(), rows.cols());
  for (const Step& step : steps_) {
    auto there = rows.middleRows(step.first, step.rows);
    const Eigen::MatrixXd innovation = there - step.sees * expected;
    there = step.root.matrixL().solve(innovation);
    expected = keeps_.asDiagonal() * (expected + step.gain * innovation);
  }
}

void NoiseOfScans::whiten(Eigen::MatrixXd& columns) const {
  auto rows = columns.middleRows(first_, rows_);
  rows = weight_.asDiagonal() * rows;
  filter(rows);
  rows -= means_ * (means_.transpose() * rows).eval();
}

}  // namespace fit::explain::model
