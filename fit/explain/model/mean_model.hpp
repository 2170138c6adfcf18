// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Dense>
#include <utility>
#include <vector>

#include "fit/explain/model/rows.hpp"
#include "fit/explain/model/shared_errors.hpp"
#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain {

/// How well the means of cells are known: factor on the white noise, and what all cells of a group have in
/// common beyond it.
struct MeanNoise {
  double factor = 1;               ///< On the variance of every mean: autocorrelated noise.
  double neighbours = 1;           ///< The same: noise that neighbouring beams share ...
  std::vector<double> neighbours_of_target;  ///< ... where it is more than that; empty: nowhere.
  std::vector<double> range_mm2;   ///< Variance of a range common to a group; empty: none.
  std::vector<double> angle_rad2;  ///< Variance of an angle common to a group; empty: none.
  double stop_rad2 = 0;            ///< Variance of an angle common to a stop of the stage.
  /// Variances of one scan's common range and angle: part of the samples' own spread, and counted above.
  double scan_range_mm2 = 0, scan_angle_rad2 = 0;
  double ar1_rho = 0, ar1_share = 0;  ///< Of the samples' noise, from scan to scan.
  double footprint_rad = 0;  ///< Standard half width of the beam where edges show it; 0: they do not.
  double spread_rad = 0;     ///< The same and how angles scatter, as a hypothesis has it.
  bool operator==(const MeanNoise&) const = default;
};

/// A prior for coefficients: independent normal ones.
struct Prior {
  Eigen::VectorXd mean, sigma;

  [[nodiscard]] static Prior around_zero(Eigen::Index count, double of_each = 1) {
    return {Eigen::VectorXd::Zero(count), Eigen::VectorXd::Constant(count, of_each)};
  }
  void append(const Prior& more);
};

/// Columns of coefficients with such priors: of means in mm, of a channel in the unit of its linear
/// predictor.
struct Columns {
  Eigen::MatrixXd columns;
  Prior prior;

  /// Joins them side by side.
  void append(const Eigen::MatrixXd& more, const Prior& prior_of_more);
  void append(const Columns& more) { append(more.columns, more.prior); }
};

/// Of a cell's mean by itself, mm^2, without what its group has in common.
[[nodiscard]] double variance_of_mean(const Cell& cell, const MeanNoise& noise);

/// Linear Gaussian model of the cells' means around the last prediction. The base (nuisance parameters,
/// accepted mechanisms) is marginalised, so that nothing is blamed on a suspect which they explain.
class MeanModel final : public model::Rows {
 public:
  MeanModel(const Reduced& reduced, const MeanNoise& noise);

  [[nodiscard]] Eigen::Index rows() const override { return static_cast<Eigen::Index>(row_.size()); }
  [[nodiscard]] const Circumstances& at(Eigen::Index row) const override { return cell(row).at; }
  [[nodiscard]] const Bench& bench() const { return reduced_->bench; }
  [[nodiscard]] const Cell& cell(Eigen::Index row) const {
    return reduced_->cells[row_[static_cast<std::size_t>(row)]];
  }
  [[nodiscard]] const Group& group(Eigen::Index row) const { return reduced_->group_of(cell(row)); }
  /// Change of the row's range that an effect makes to first order, mm.
  [[nodiscard]] double response(Eigen::Index row, const Effect& effect) const override {
    const Sensitivities& l = sensitivities_[static_cast<std::size_t>(row)];
    return effect.range_mm + l.beam_mm * effect.beam_rad + l.stage_mm * effect.stage_rad -
           (l.x * effect.origin_mm.x() + l.y * effect.origin_mm.y());
  }
  [[nodiscard]] double sigma_of_mean(Eigen::Index row) const { return 1 / weight_[row]; }
  /// With what its group has in common, mm^2.
  [[nodiscard]] double variance_of_mean(Eigen::Index row) const;
  /// Divides by what every mean has of noise of its own.
  [[nodiscard]] Eigen::MatrixXd divided_by_own_noise(Eigen::MatrixXd columns_mm) const;
  /// One column for each error that a group or a stop shares and that counts beside the rows' own noise: its
  /// standard deviation in units of that.
  [[nodiscard]] Eigen::MatrixXd shared_errors() const;
  /// Divides by the noise of the means, correlations included.
  [[nodiscard]] Eigen::MatrixXd whitened(Eigen::MatrixXd columns_mm) const;
  /// d range / d nuisance parameter.
  [[nodiscard]] Eigen::MatrixXd nuisance_columns() const;

  /// `columns` in mm; coefficients are relative to those in the prediction.
  void set_base(Eigen::MatrixXd columns_mm, const Prior& prior);

  /// Of the base's coefficients.
  [[nodiscard]] Eigen::VectorXd posterior_mean() const;
  /// What the log-likelihood there is more than integrated over the base's prior.
  [[nodiscard]] double log_occam() const;
  /// What the base cannot take up of an effect, mm; its priors resist.
  [[nodiscard]] Eigen::VectorXd remainder(const Eigen::VectorXd& column_mm) const;
  /// Residual means less the base's best fit, mm.
  [[nodiscard]] Eigen::VectorXd residual() const;
  [[nodiscard]] const Eigen::VectorXd& raw_residual() const { return residual_; }

 private:
  const Reduced* reduced_;
  std::vector<std::size_t> row_;
  /// What every effect is multiplied by, side by side: they are asked for far more often than cells are.
  struct Sensitivities {
    double beam_mm = 0, stage_mm = 0;  ///< d range / d angle, per rad.
    double x = 0, y = 0;               ///< - d range / d place of the optical centre.
  };
  std::vector<Sensitivities> sensitivities_;
  Eigen::VectorXd weight_, residual_, white_;
  struct Common {
    double range_sigma = 0, angle_sigma = 0, stop_sigma = 0;
    int stop = -1;
  };
  void share_stops(double sigma_rad, const std::vector<std::pair<Eigen::Index, Eigen::Index>>& group_rows);
  std::vector<Common> common_;
  std::vector<model::SharedErrors> shared_;
  Eigen::MatrixXd base_;  ///< Whitened, scaled by the priors' sigmas.
  Eigen::VectorXd base_sigma_, base_mean_, along_;
  Eigen::LLT<Eigen::MatrixXd> factor_;
  Eigen::VectorXd centred_;
};

/// Sets every cell's variance of one sample, pooled over its neighbours on the same target. Needed before any
/// MeanModel is made. What a scan's cells have in common is taken off: it is counted once for all of them.
void pool_variances(Reduced& reduced, const MeanNoise& noise = {});
/// Factor by which means scatter more than their samples say, from neighbouring cells.
[[nodiscard]] double birge_ratio(const MeanModel& model);

}  // namespace fit::explain
