// SPDX-License-Identifier: MIT
#include "fit/explain/model/mean_model.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "fit/explain/model/stage_stops.hpp"
#include "fit/numeric/median.hpp"

namespace fit::explain {
namespace {

constexpr double never_mm = 1e-3;  // no mean is believed to better than this
constexpr int pooled_beams = 12;

/// Rounding to 1 mm leaves the mean this uncertain when the noise does not smear it out (first harmonic of
/// the sawtooth).
double rounding_variance(double sigma_mm) { return std::exp(-4 * pi * pi * sigma_mm * sigma_mm) / 12; }

/// Of one sample about what its scan has in common.
double own_variance(const Cell& cell, const MeanNoise& noise) {
  const double common =
      noise.scan_range_mm2 + noise.scan_angle_rad2 * std::pow(cell.sight.stage_sensitivity(), 2);
  return std::max(0.1 * cell.variance_mm2,
                  cell.variance_mm2 - common - cell.of_scans_mm2 - cell.of_joining_mm2());
}

}  // namespace

void Prior::append(const Prior& more) {
  mean.conservativeResize(mean.size() + more.mean.size());
  mean.tail(more.mean.size()) = more.mean;
  sigma.conservativeResize(sigma.size() + more.sigma.size());
  sigma.tail(more.sigma.size()) = more.sigma;
}

void Columns::append(const Eigen::MatrixXd& more, const Prior& prior_of_more) {
  if (more.cols() == 0) return;
  columns.conservativeResize(more.rows(), columns.cols() + more.cols());
  columns.rightCols(more.cols()) = more;
  prior.append(prior_of_more);
}

void pool_variances(Reduced& reduced, const MeanNoise& noise) {
  // What a handful of samples is helped by: their own scans, or the whole session.
  struct Sum {
    double squares = 0, freedom = 0;
    [[nodiscard]] double mean() const { return freedom > 0 ? squares / freedom : 100; }
  };
  Sum all;
  std::vector<Sum> own_scans(reduced.groups.size());
  for (const Cell& cell : reduced.cells) {
    if (!cell.usable || cell.n < 2 || cell.sight.target < 0) continue;
    for (Sum* sum : {&all, &own_scans[static_cast<std::size_t>(cell.group)]}) {
      sum->squares += own_variance(cell, noise) * (cell.n - 1);
      sum->freedom += cell.n - 1;
    }
  }
  for (const Group& group : reduced.groups) {
    const std::size_t count = group.last_cell - group.first_cell;
    std::vector<double> squares(count + 1, 0.0), freedom(count + 1, 0.0);
    for (std::size_t k = 0; k < count; ++k) {
      const Cell& cell = reduced.cells[group.first_cell + k];
      const bool good = cell.usable && cell.n > 1 && cell.sight.target >= 0;
      squares[k + 1] = squares[k] + (good ? own_variance(cell, noise) * (cell.n - 1) : 0);
      freedom[k + 1] = freedom[k] + (good ? cell.n - 1 : 0);
    }
    for (std::size_t k = 0; k < count; ++k) {
      const int target = reduced.cells[group.first_cell + k].sight.target;
      std::size_t low = k, high = k + 1;
      while (low > 0 && k - low < pooled_beams &&
             reduced.cells[group.first_cell + low - 1].sight.target == target)
        --low;
      while (high < count && high - k < pooled_beams &&
             reduced.cells[group.first_cell + high].sight.target == target)
        ++high;
      const double own = freedom[high] - freedom[low];
      constexpr double borrowed = 20;
      const Sum& scans = own_scans[static_cast<std::size_t>(&group - reduced.groups.data())];
      const double prior = (scans.freedom > 60 ? scans : all).mean();
      reduced.cells[group.first_cell + k].pooled_mm2 =
          std::max(rounding_mm2, (squares[high] - squares[low] + borrowed * prior) / (own + borrowed));
    }
  }
}

double variance_of_mean(const Cell& cell, const MeanNoise& noise) {
  const double v = cell.pooled_mm2, u_edge_mm = std::max(cell.u_edge_mm, cell.mixed_mm);
  const auto target = static_cast<std::size_t>(std::max(0, cell.sight.target));
  double neighbours = noise.neighbours;
  if (target < noise.neighbours_of_target.size())
    neighbours = std::max(neighbours, noise.neighbours_of_target[target]);
  return noise.factor * neighbours * v / cell.n + rounding_variance(std::sqrt(v)) + never_mm * never_mm +
         u_edge_mm * u_edge_mm;
}

MeanModel::MeanModel(const Reduced& reduced, const MeanNoise& noise) : reduced_(&reduced) {
  std::vector<double> weights, residuals;
  std::vector<std::pair<Eigen::Index, Eigen::Index>> group_rows;
  bool has_common = false;
  for (std::size_t g = 0; g < reduced.groups.size(); ++g) {
    const Group& group = reduced.groups[g];
    const auto first = static_cast<Eigen::Index>(row_.size());
    for (std::size_t i = group.first_cell; i < group.last_cell; ++i) {
      const Cell& cell = reduced.cells[i];
      if (!cell.usable) continue;
      row_.push_back(i);
      const Sight& sight = cell.sight;
      sensitivities_.push_back({sight.beam_sensitivity(), sight.stage_sensitivity(),
                                sight.normal.x() / sight.cos_incidence(),
                                sight.normal.y() / sight.cos_incidence()});
      weights.push_back(1 / std::sqrt(explain::variance_of_mean(cell, noise)));
      residuals.push_back(cell.off_mm());
    }
    group_rows.emplace_back(first, static_cast<Eigen::Index>(row_.size()));
    Common common;
    if (!noise.range_mm2.empty()) common.range_sigma = std::sqrt(noise.range_mm2[g]);
    if (!noise.angle_rad2.empty()) common.angle_sigma = std::sqrt(noise.angle_rad2[g]);
    has_common = has_common || common.range_sigma > 0 || common.angle_sigma > 0;
    common_.push_back(common);
  }
  weight_ = Eigen::Map<Eigen::VectorXd>(weights.data(), static_cast<Eigen::Index>(weights.size()));
  residual_ = Eigen::Map<Eigen::VectorXd>(residuals.data(), static_cast<Eigen::Index>(residuals.size()));
  for (std::size_t g = 0; has_common && g < group_rows.size(); ++g) {
    const auto [first, last] = group_rows[g];
    Eigen::MatrixXd z(last - first, 2);
    for (Eigen::Index i = first; i < last; ++i)
      z.row(i - first) << weight_[i] * common_[g].range_sigma,
          weight_[i] * cell(i).sight.stage_sensitivity() * common_[g].angle_sigma;
    if (first < last) shared_.emplace_back(first, std::move(z));
  }
  if (noise.stop_rad2 > 0) share_stops(std::sqrt(noise.stop_rad2), group_rows);
  white_ = whitened(residual_);
  set_base(Eigen::MatrixXd(rows(), 0), {});
}

void MeanModel::share_stops(double sigma_rad,
                            const std::vector<std::pair<Eigen::Index, Eigen::Index>>& group_rows) {
  const std::vector<Stop> stops = stops_of(*reduced_);
  Eigen::MatrixXd z = Eigen::MatrixXd::Zero(rows(), 1);
  for (const Stop& stop : stops)
    for (std::size_t g = stop.first_group; g < stop.last_group; ++g) {
      common_[g].stop_sigma = sigma_rad;
      common_[g].stop = static_cast<int>(&stop - stops.data());
      for (Eigen::Index i = group_rows[g].first; i < group_rows[g].second; ++i)
        z(i, 0) = weight_[i] * cell(i).sight.stage_sensitivity() * sigma_rad;
    }
  for (const model::SharedErrors& errors : shared_)
    errors.whiten(z);  // what groups share is divided out first
  for (const Stop& stop : stops) {
    const Eigen::Index first = group_rows[stop.first_group].first,
                       last = group_rows[stop.last_group - 1].second;
    if (first < last) shared_.emplace_back(first, z.middleRows(first, last - first));
  }
}

Eigen::MatrixXd MeanModel::divided_by_own_noise(Eigen::MatrixXd columns) const {
  columns.array().colwise() *= weight_.array();
  return columns;
}

Eigen::MatrixXd MeanModel::shared_errors() const {
  const double counts = 0.01;  // of the information on it
  enum Of { range, angle, stop };
  std::map<std::pair<Of, int>, Eigen::VectorXd> columns;
  const auto add = [&](Of of, int which, Eigen::Index row, double sigma) {
    if (sigma == 0) return;
    const auto column = columns.try_emplace({of, which}, Eigen::VectorXd::Zero(rows())).first;
    column->second[row] = weight_[row] * sigma;
  };
  for (Eigen::Index i = 0; i < rows(); ++i) {
    const Common& common = common_[static_cast<std::size_t>(cell(i).group)];
    const double sensitivity = cell(i).sight.stage_sensitivity();
    add(range, cell(i).group, i, common.range_sigma);
    add(angle, cell(i).group, i, sensitivity * common.angle_sigma);
    add(stop, common.stop, i, sensitivity * common.stop_sigma);
  }
  std::erase_if(columns, [&](const auto& column) { return column.second.squaredNorm() < counts; });
  Eigen::MatrixXd all(rows(), static_cast<Eigen::Index>(columns.size()));
  Eigen::Index k = 0;
  for (const auto& [of, column] : columns) all.col(k++) = column;
  return all;
}

Eigen::MatrixXd MeanModel::whitened(Eigen::MatrixXd white) const {
  white = divided_by_own_noise(std::move(white));
  for (const model::SharedErrors& errors : shared_) errors.whiten(white);
  return white;
}

double MeanModel::variance_of_mean(Eigen::Index row) const {
  const Common& common = common_[static_cast<std::size_t>(cell(row).group)];
  return 1 / (weight_[row] * weight_[row]) + common.range_sigma * common.range_sigma +
         std::pow(cell(row).sight.stage_sensitivity() * std::hypot(common.angle_sigma, common.stop_sigma), 2);
}

Eigen::MatrixXd MeanModel::nuisance_columns() const {
  const std::vector<Freedom> freedoms = freedoms_of(reduced_->bench);
  std::vector<std::pair<std::size_t, std::size_t>> of_target(reduced_->bench.targets.size());
  for (std::size_t k = freedoms.size(); k-- > 0;) {
    if (freedoms[k].target < 0) continue;
    auto& [first, last] = of_target[static_cast<std::size_t>(freedoms[k].target)];
    first = k;
    last = std::max(last, k + 1);
  }
  constexpr std::size_t of_mount = 3;
  Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(rows(), static_cast<Eigen::Index>(freedoms.size()));
  for (Eigen::Index i = 0; i < rows(); ++i) {
    const Sight& sight = cell(i).sight;
    const double stage_rad = group(i).stage_rad;
    const auto fill = [&](std::size_t k) {
      columns(i, static_cast<Eigen::Index>(k)) = sight.per(freedoms[k], stage_rad);
    };
    for (std::size_t k = 0; k < of_mount; ++k) fill(k);
    const auto [first, last] = of_target[static_cast<std::size_t>(sight.target)];
    for (std::size_t k = first; k < last; ++k) fill(k);
  }
  return columns;
}

void MeanModel::set_base(Eigen::MatrixXd columns, const Prior& prior) {
  base_sigma_ = prior.sigma;
  base_mean_ = prior.mean;
  // In place: of a million cells these are hundreds of megabytes.
  base_ = whitened(std::move(columns));
  centred_ = white_;
  if (base_.cols() > 0) {
    centred_ -= base_ * prior.mean;
    base_.array().rowwise() *= prior.sigma.transpose().array();
  }
  Eigen::MatrixXd normal = base_.transpose() * base_;
  normal.diagonal().array() += 1;
  factor_.compute(normal);
  along_ = base_.transpose() * centred_;
}

Eigen::VectorXd MeanModel::posterior_mean() const {
  return base_mean_ + base_sigma_.cwiseProduct(factor_.solve(along_));
}

double MeanModel::log_occam() const {
  return factor_.solve(along_).squaredNorm() / 2 +
         factor_.matrixLLT().diagonal().array().log().sum();  // half the logarithm of the determinant
}

Eigen::VectorXd MeanModel::residual() const {
  const Eigen::VectorXd white = centred_ - base_ * factor_.solve(along_);
  // Correlated parts stay in; only the scale goes back to millimetres.
  return white.cwiseQuotient(weight_);
}

Eigen::VectorXd MeanModel::remainder(const Eigen::VectorXd& column) const {
  const Eigen::VectorXd white = whitened(column);
  if (base_.cols() == 0) return white.cwiseQuotient(weight_);
  return (white - base_ * factor_.solve(base_.transpose() * white)).cwiseQuotient(weight_);
}

double birge_ratio(const MeanModel& model) {
  const Eigen::VectorXd residual = model.residual();
  std::vector<double> ratios;
  for (Eigen::Index i = 1; i + 1 < model.rows(); ++i) {
    const Cell &a = model.cell(i - 1), &b = model.cell(i), &c = model.cell(i + 1);
    if (a.group != c.group || a.at.target != c.at.target || b.at.target != c.at.target) continue;
    if (std::abs(c.beam_rad - a.beam_rad) > 3 * rad_per_deg) continue;
    const double sa = model.sigma_of_mean(i - 1), sb = model.sigma_of_mean(i),
                 sc = model.sigma_of_mean(i + 1);
    const double bend = residual[i] - (residual[i - 1] + residual[i + 1]) / 2;
    ratios.push_back(bend * bend / (sb * sb + (sa * sa + sc * sc) / 4));
  }
  if (ratios.size() < 60) return 1;
  return median_of(ratios) / median_of_normal_squares;
}

}  // namespace fit::explain
