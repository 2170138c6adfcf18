// SPDX-License-Identifier: MIT
#include "fit/explain/spread/variance_model.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "fit/explain/spread/unseen.hpp"

namespace fit::explain::spread {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

template <typename T>
std::vector<T> those(const std::vector<T>& list, const std::vector<bool>& wanted) {
  std::vector<T> result;
  for (std::size_t i = 0; i < list.size(); ++i)
    if (wanted[i]) result.push_back(list[i]);
  return result;
}

/// How much more a variance of these samples scatters than one of normal samples does: they have tails.
double excess_scatter(const std::vector<Pool>& pools) {
  double kurtosis = 0, freedom = 0;
  for (const Pool& p : pools) {
    kurtosis += p.freedom * p.kurtosis;
    freedom += p.freedom;
  }
  return freedom > 0 ? std::max(1.0, (kurtosis / freedom - 1) / 2) : 1;
}

/// The same of some of the pools.
Parts those(Parts parts, const std::vector<bool>& wanted) {
  for (Column& column : parts.columns) column = those(column, wanted);
  return parts;
}

}  // namespace

double place_of(const Pool& pool, Coordinate coordinate) {
  switch (coordinate) {
    case Coordinate::stage:
      return pool.stage_deg;
    case Coordinate::range:
      return pool.range_mm;
    case Coordinate::intensity:
      return pool.intensity;
    case Coordinate::incidence:
      return std::abs(pool.incidence_deg);
    case Coordinate::time:
      return pool.time_s;
    case Coordinate::target:
      return pool.target;
    default:
      return pool.beam_deg;
  }
}

std::vector<Pool> pools_of(const Reduced& reduced) {
  std::vector<Pool> pools;
  constexpr int beams = 8;
  for (const Group& group : reduced.groups) {
    if (group.scans < 3) continue;
    Pool pool;
    int count = 0, target = -1;
    const auto finish = [&] {
      if (count > 0 && pool.freedom > 0) {
        pool.variance /= pool.freedom;
        pool.beam_deg /= count;
        pool.intensity /= count;
        pool.range_mm /= count;
        pool.incidence_deg /= count;
        pool.kurtosis /= pool.freedom;
        pool.lever2 /= count;
        pools.push_back(pool);
      }
      pool = Pool();
      count = 0;
    };
    for (std::size_t i = group.first_cell; i < group.last_cell; ++i) {
      const Cell& cell = reduced.cells[i];
      if (!cell.smooth || cell.n < 2) continue;
      if (count == beams || cell.at.target != target) finish();
      target = cell.at.target;
      pool.capture = group.capture;
      pool.target = target;
      pool.time_s = group.time_s;
      pool.stage_deg = group.stage_rad * deg_per_rad;
      const double lever = cell.sight.beam_lever();
      pool.freedom += cell.n - 1;
      pool.lost += cell.lost;
      pool.variance += (cell.n - 1) * cell.variance_mm2;
      pool.kurtosis += (cell.n - 1) * cell.kurtosis;
      pool.beam_deg += cell.beam_rad * deg_per_rad;
      pool.intensity += cell.at.intensity;
      pool.range_mm += cell.at.range_mm;
      pool.incidence_deg += cell.at.incidence_rad * deg_per_rad;
      pool.lever2 += lever * lever;
      ++count;
    }
    finish();
  }
  return pools;
}

Parts Parts::with(const Column& column) const {
  Parts more = *this;
  more.columns.push_back(column);
  return more;
}

Parts Parts::without(const std::set<std::size_t>& those) const {
  Parts fewer = *this;
  fewer.columns.clear();
  for (std::size_t i = 0; i < columns.size(); ++i)
    if (!those.contains(i)) fewer.columns.push_back(columns[i]);
  return fewer;
}

Estimate VarianceModel::Fit::at(std::size_t index) const {
  return {value[static_cast<Index>(index)], sigma[static_cast<Index>(index)]};
}

Estimate VarianceModel::Fit::last() const { return at(static_cast<std::size_t>(value.size()) - 1); }

VarianceModel::VarianceModel(std::vector<Pool> pools, Estimate stated_mm, double fixed_mm2,
                             double worth_of_sample)
    : pools_(std::move(pools)),
      stated_mm_(stated_mm),
      fixed_mm2_(fixed_mm2),
      worth_of_sample_(worth_of_sample / excess_scatter(pools_)) {}

Estimate VarianceModel::stated_variance() const {
  return {stated_mm_.value * stated_mm_.value, 2 * stated_mm_.value * stated_mm_.u};
}

double VarianceModel::mean_variance() const {
  double mean = 0, freedom = 0;
  for (const Pool& p : pools_) {
    mean += p.freedom * p.variance;
    freedom += p.freedom;
  }
  return freedom > 0 ? mean / freedom : stated_variance().value;
}

/// Nearly all of the variance is constant, and every part has a little.
VectorXd VarianceModel::start(const Parts& parts) const {
  const double mean = mean_variance();
  VectorXd x = VectorXd::Zero(static_cast<Index>(parts.columns.size()) + 1);
  x[0] = std::max(0.05 * mean, mean - fixed_mm2_);
  for (std::size_t j = 0; j < parts.columns.size(); ++j) {
    double scale = 0;
    for (const double c : parts.columns[j]) scale += c;
    scale /= static_cast<double>(std::max<std::size_t>(1, pools_.size()));
    x[static_cast<Index>(j) + 1] = scale > 0 ? 0.05 * mean / scale : 0;
  }
  return x;
}

VarianceModel::Fit VarianceModel::fit(const Parts& parts) const {
  const auto k = static_cast<Index>(parts.columns.size()) + 1;
  const double s0 = stated_mm_.value, prior_mean = s0 * s0,
               prior_sigma = std::max(0.02 * s0 * s0, stated_variance().u);
  const double least = 1e-3 * mean_variance();
  VectorXd x = start(parts);
  Eigen::MatrixXd normal(k, k);
  VectorXd row(k);
  for (int iteration = 0; iteration < 12; ++iteration) {
    VectorXd rhs = VectorXd::Zero(k);
    normal.setZero();
    for (std::size_t i = 0; i < pools_.size(); ++i) {
      row[0] = 1;
      for (Index j = 1; j < k; ++j) row[j] = parts.columns[static_cast<std::size_t>(j - 1)][i];
      const double v = std::max(1e-3, row.dot(x) + fixed_mm2_);
      const double w = worth_of_sample_ * pools_[i].freedom / (2 * v * v);
      normal.noalias() += w * row * row.transpose();
      rhs.noalias() += w * (pools_[i].variance - fixed_mm2_) * row;
    }
    if (!parts.free) {
      normal(0, 0) += 1 / (prior_sigma * prior_sigma);
      rhs[0] += prior_mean / (prior_sigma * prior_sigma);
    }
    for (Index j = 0; j < k; ++j) normal(j, j) *= 1 + 1e-9;
    VectorXd next = normal.ldlt().solve(rhs);
    if (!next.allFinite()) break;
    for (Index j = static_cast<Index>(parts.places) + 1; j < k; ++j) next[j] = std::max(next[j], 0.0);
    next[0] = std::max(next[0], least);
    const bool settled = (next - x).norm() < 1e-6 * (1 + x.norm());
    x = next;
    if (settled) break;
  }
  Fit result;
  result.value = x;
  result.sigma = normal.inverse().diagonal().cwiseAbs().cwiseSqrt();
  result.log_likelihood = likelihood(parts, x);
  if (!parts.free) result.log_likelihood -= 0.5 * std::pow((x[0] - prior_mean) / prior_sigma, 2);
  return result;
}

double VarianceModel::likelihood(const Parts& parts, const VectorXd& x) const {
  double sum = 0;
  for (std::size_t i = 0; i < pools_.size(); ++i) {
    double v = x[0] + fixed_mm2_;
    for (std::size_t j = 0; j < parts.columns.size(); ++j)
      v += parts.columns[j][i] * x[static_cast<Index>(j) + 1];
    v = std::max(1e-3, v);
    sum -= worth_of_sample_ * pools_[i].freedom / 2 * (std::log(v) + pools_[i].variance / v);
  }
  return sum;
}

std::vector<double> VarianceModel::variances(const Parts& parts, const Fit& fit) const {
  std::vector<double> list;
  for (std::size_t i = 0; i < pools_.size(); ++i) {
    double v = fit.value[0] + fixed_mm2_;
    for (std::size_t j = 0; j < parts.columns.size(); ++j)
      v += parts.columns[j][i] * fit.value[static_cast<Index>(j) + 1];
    list.push_back(std::max(1e-3, v));
  }
  return list;
}

std::map<int, int> VarianceModel::block_of_captures() const {
  std::set<int> captures;
  for (const Pool& p : pools_) captures.insert(p.capture);
  if (captures.size() < 3) return {};
  return block_of_capture(captures, static_cast<int>(std::min<std::size_t>(8, captures.size())));
}

VarianceModel VarianceModel::only(const std::vector<bool>& wanted) const {
  VarianceModel some = *this;
  some.pools_ = those(pools_, wanted);
  return some;
}

template <class Each>
bool VarianceModel::for_blocks(const Each& each) const {
  const std::map<int, int> block = block_of_captures();
  for (int b = 0; b < blocks_in(block); ++b) {
    std::vector<bool> own, others;
    for (const Pool& p : pools_) {
      own.push_back(block.at(p.capture) == b);
      others.push_back(!own.back());
    }
    const VarianceModel taught = only(others), asked = only(own);
    each([&](const Parts& parts, bool own_constant) {
      const Parts there = those(parts, own);
      const VectorXd learnt = taught.fit(those(parts, others)).value;
      return own_constant ? asked.with_own_constant(there, learnt) : asked.likelihood(there, learnt);
    });
  }
  return !block.empty();
}

std::optional<double> VarianceModel::unseen_gain(const Parts& parts, const Parts& with_more) const {
  Unseen unseen;
  const auto ask = [&](const auto& predicted) {
    unseen.add(predicted(with_more, true) - predicted(parts, true));
  };
  return for_blocks(ask) ? std::optional(unseen.gain()) : std::nullopt;
}

std::optional<double> VarianceModel::held_out_gain(const Parts& parts, const Parts& with_more) const {
  // How noisy a place is that nobody saw, no other place says.
  const bool own_constant = with_more.places > 0;
  double gain = 0;
  const auto ask = [&](const auto& predicted) {
    gain += predicted(with_more, own_constant) - predicted(parts, own_constant);
  };
  return for_blocks(ask) ? std::optional(gain) : std::nullopt;
}

/// Best likelihood over the constant variance, all other sizes given.
double VarianceModel::with_own_constant(const Parts& parts, VectorXd x) const {
  for (std::size_t j = 1; j <= parts.places; ++j) x[static_cast<Index>(j)] = 0;
  double best = -1e300, at = x[0];
  for (double step = 2, from = at; step > 1.01; step = std::sqrt(step), from = at)
    for (int k = -6; k <= 6; ++k) {
      x[0] = from * std::pow(step, k);
      const double l = likelihood(parts, x);
      if (l <= best) continue;
      best = l;
      at = x[0];
    }
  return best;
}

}  // namespace fit::explain::spread
