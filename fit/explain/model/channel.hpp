// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Dense>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "fit/explain/model/mean_model.hpp"
#include "fit/explain/model/results.hpp"
#include "fit/explain/model/rows.hpp"

/// The statistical model of docs/method/model.md: rows in channels, and what acts on them.
namespace fit::explain::model {

/// The rows of one statistic. Their distribution depends on a linear predictor (eta): a sum over nuisances
/// and terms.
class ChannelRows : public Rows {
 public:
  struct Row {
    Circumstances at;
    int capture = 0;
    double y = 0;  ///< The statistic: a mean, a variance, or a count.
    Draws draws = {};
    double sensitivity2 = 0;  ///< Mean square of d range / d beam angle, (mm/rad)^2.
    double n = 0;         ///< Degrees of freedom, or samples.
    double expected = 0;  ///< Of a variance: what of it is predicted from scan to scan; of strays: the noise
                          ///< beside them, mm.
  };

  [[nodiscard]] Eigen::Index rows() const final { return std::ssize(rows_); }
  [[nodiscard]] const Circumstances& at(Eigen::Index row) const final { return of(row).at; }
  /// Of which capture the row's samples are.
  [[nodiscard]] int capture(Eigen::Index row) const { return of(row).capture; }
  /// Whether what changes along that coordinate is for these rows: from scan to scan, or from cell to cell.
  [[nodiscard]] virtual bool sees(Coordinate coordinate) const { return coordinate != Coordinate::scan_seq; }
  /// Whether nothing but a comb of ranges changes as finely as these rows tell.
  [[nodiscard]] virtual bool sees_only_combs() const { return false; }
  /// Nuisances that every hypothesis has.
  [[nodiscard]] const Columns& base() const { return base_; }
  void append_to_base(const Columns& more) { base_.append(more); }
  /// Of the predictor where all coefficients are zero.
  [[nodiscard]] virtual double offset(Eigen::Index row) const = 0;

  /// The statistic itself ...
  [[nodiscard]] double statistic(Eigen::Index row) const { return of(row).y; }
  /// ... in the unit of the predictor.
  [[nodiscard]] virtual double seen(Eigen::Index row) const { return statistic(row); }
  [[nodiscard]] virtual double log_likelihood(const Eigen::VectorXd& eta) const = 0;
  /// The same of every row; of rows with a common error, as if each came alone.
  [[nodiscard]] virtual Eigen::VectorXd log_likelihoods(const Eigen::VectorXd& eta) const = 0;
  /// Where to linearise for terms that are not in the predictor yet: as high as the rows are on the whole.
  [[nodiscard]] virtual Eigen::VectorXd expansion_for_new_terms(const Eigen::VectorXd& eta) const {
    return eta;
  }
  /// The predictor that the likelihood takes it for, where sums of terms may come to what cannot be.
  [[nodiscard]] virtual Eigen::VectorXd feasible(Eigen::VectorXd eta) const { return eta; }
  /// Where the information holds for steps of a usual size from there: at a bound it may be beyond all
  /// measure.
  [[nodiscard]] virtual Eigen::VectorXd expansion_for_steps(Eigen::VectorXd eta) const { return eta; }
  /// Where the information is the likelihood's curvature there: of what is rare and happened, the expected
  /// one is too small.
  [[nodiscard]] virtual Eigen::VectorXd expansion_for_evidence(Eigen::VectorXd eta) const {
    return expansion_for_steps(std::move(eta));
  }
  /// Where the information is what the likelihood curves by there, if it curves down.
  [[nodiscard]] virtual Eigen::VectorXd expansion_for_last_steps(Eigen::VectorXd eta) const {
    return expansion_for_steps(std::move(eta));
  }
  /// Whether the information is the same at any predictor. Where it is not, rows are independent.
  [[nodiscard]] virtual bool has_fixed_information() const { return false; }
  /// Columns multiplied by a root of the Fisher information at eta.
  [[nodiscard]] virtual Eigen::MatrixXd whitened(Eigen::MatrixXd columns,
                                                 const Eigen::VectorXd& eta) const = 0;
  /// What each row says of its predictor, as if it came alone.
  [[nodiscard]] virtual Eigen::VectorXd information(const Eigen::VectorXd& eta) const {
    return whitened(Eigen::VectorXd::Ones(rows()), eta).cwiseAbs2();
  }
  /// Derivative of the log-likelihood by the predictor of every row.
  [[nodiscard]] virtual Eigen::VectorXd score(const Eigen::VectorXd& eta) const {
    return whitened(Eigen::VectorXd::Ones(rows()), eta).col(0).cwiseProduct(white_residual(eta));
  }
  /// The same, as if each row came alone.
  [[nodiscard]] virtual Eigen::VectorXd score_alone(const Eigen::VectorXd& eta) const { return score(eta); }
  /// The score divided by that root: what a scoring step is fitted to.
  [[nodiscard]] virtual Eigen::VectorXd white_residual(const Eigen::VectorXd& eta) const = 0;

  /// How well the rows agree with their predictors before and after anything was found; empty: no word.
  [[nodiscard]] virtual std::string note(const Eigen::VectorXd&, const Eigen::VectorXd&) const { return {}; }
  /// What is left beside all that was found and that no usual device and no usual scene shows.
  [[nodiscard]] virtual std::vector<Unexplained> unexplained(const Eigen::VectorXd&) const { return {}; }
  /// How pictures show the rows before and after, where not along a coordinate.
  [[nodiscard]] virtual std::optional<SpreadCurve> picture(const Eigen::VectorXd&,
                                                           const Eigen::VectorXd&) const {
    return {};
  }

 protected:
  void set_rows(std::vector<Row> rows) {
    rows_ = std::move(rows);
    base_.columns.resize(this->rows(), 0);
  }
  [[nodiscard]] const Row& of(Eigen::Index row) const { return rows_[static_cast<std::size_t>(row)]; }
  [[nodiscard]] const std::vector<Row>& list() const { return rows_; }
  void set_base(Columns base) { base_ = std::move(base); }

 private:
  std::vector<Row> rows_;
  Columns base_;
};

/// A channel whose rows are normal around the predictor, with the same information whatever that is.
class NormalRows : public ChannelRows {
 public:
  [[nodiscard]] double offset(Eigen::Index) const override { return 0; }
  [[nodiscard]] double log_likelihood(const Eigen::VectorXd& eta) const override {
    return log_scale_ - 0.5 * white_residual(eta).squaredNorm();
  }
  [[nodiscard]] Eigen::VectorXd log_likelihoods(const Eigen::VectorXd& eta) const override {
    return -0.5 * white_residual(eta).cwiseAbs2();
  }
  [[nodiscard]] bool has_fixed_information() const override { return true; }
  [[nodiscard]] Eigen::VectorXd score_alone(const Eigen::VectorXd& eta) const override;
  [[nodiscard]] Eigen::VectorXd white_residual(const Eigen::VectorXd& eta) const override;

 protected:
  /// Log of the density where nothing is left over.
  void set_log_scale(double log_scale) { log_scale_ = log_scale; }

 private:
  double log_scale_ = 0;
};

/// One kind of statistic. A new one is one new file fit/channels/NAME.cpp with a function make_NAME().
struct ChannelKind {
  std::string id;
  Observable observable = Observable::range_mean;
  std::string shows, unit;               ///< What pictures of it show.
  bool is_square = false;                ///< Pictures show its root.
  std::vector<Coordinate> always_drawn;  ///< Along which pictures show it whatever was found.
  bool of_predicted = false;             ///< Its rows are deviations of means from what was predicted.
  bool has_forms = true;                 ///< Whether unnamed functions are asked for here.
  std::string table;  ///< What tables of bench files add to, if they can tell what an unnamed function does
                      ///< here (fit/bench/empirical.hpp).
  /// Puts its nuisances as they were found into the bench, where that states them; empty: it does not.
  std::function<void(const Reduced&, const std::vector<Estimate>& nuisances, Bench&)> restate;
  /// The rows of a session whose cells are predicted; null if it has none.
  std::function<std::unique_ptr<ChannelRows>(const Reduced&, const MeanNoise&)> rows;
};

/// All kinds of statistics there are.
[[nodiscard]] const std::vector<ChannelKind>& channel_kinds();
/// Which of them has that name.
[[nodiscard]] std::size_t channel_of(const std::string& id);

/// A channel whose rows are independent, each with a weight of its own: what generalised linear models have.
class IndependentRows : public ChannelRows {
 public:
  [[nodiscard]] double log_likelihood(const Eigen::VectorXd& eta) const override {
    return log_likelihoods(eta).sum();
  }
  [[nodiscard]] Eigen::VectorXd log_likelihoods(const Eigen::VectorXd& eta) const override;
  [[nodiscard]] Eigen::MatrixXd whitened(Eigen::MatrixXd columns, const Eigen::VectorXd& eta) const override;
  [[nodiscard]] Eigen::VectorXd white_residual(const Eigen::VectorXd& eta) const override;
  using ChannelRows::information;
  using ChannelRows::score;

 protected:
  explicit IndependentRows(std::vector<Row> rows) { set_rows(std::move(rows)); }

  [[nodiscard]] virtual double log_likelihood(Eigen::Index row, double eta) const = 0;
  [[nodiscard]] virtual double score(Eigen::Index row, double eta) const = 0;
  [[nodiscard]] virtual double information(Eigen::Index row, double eta) const = 0;
};

/// Says whether a cell counts, and adds it to the row.
using TakeCell = std::function<bool(std::size_t cell, IndependentRows::Row& row)>;
/// Rows of neighbouring cells on the same target, as many together as a search has time for, but at least
/// `count`.
[[nodiscard]] std::vector<IndependentRows::Row> pooled_rows(const Reduced& reduced, int count,
                                                            const TakeCell& take);
/// The same of counts, with no more cells in a row once it has `enough` samples. Rows are small where
/// anything happened: of nothing, many cells together say the same as each alone.
[[nodiscard]] std::vector<IndependentRows::Row> counted_rows(const Reduced& reduced, int count,
                                                             const TakeCell& take, double enough = 1e300);

}  // namespace fit::explain::model
