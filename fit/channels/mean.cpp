// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "fit/explain/model/channel.hpp"
#include "fit/explain/model/hypothesis.hpp"
#include "fit/explain/model/rough_surfaces.hpp"
#include "fit/explain/model/shared_errors.hpp"
#include "fit/explain/numbers.hpp"

namespace fit::explain::channels {
namespace {

using Eigen::Index;

/// No surface is even: cosines along every target that is seen, out along its normal.
Columns of_uneven_surfaces(const MeanModel& model) {
  constexpr Index cosines = numbers::uneven_cosines;
  std::map<int, Index> first;
  for (Index i = 0; i < model.rows(); ++i)
    first.try_emplace(model.cell(i).at.target, cosines * std::ssize(first));
  Columns out{Eigen::MatrixXd::Zero(model.rows(), cosines * std::ssize(first)),
              Prior::around_zero(cosines * std::ssize(first))};
  for (Index k = 0; k < out.prior.sigma.size(); ++k)
    out.prior.sigma[k] = numbers::uneven_mm / static_cast<double>(k % cosines + 1);
  for (Index i = 0; i < model.rows(); ++i) {
    const Circumstances& at = model.cell(i).at;
    const double along = std::clamp(at.along_mm / at.half_length_mm, -1.0, 1.0);
    for (Index k = 0; k < cosines; ++k)
      out.columns(i, first.at(at.target) + k) =
          std::cos(static_cast<double>(k + 1) * pi * (along + 1) / 2) * range_per_mm_out(at.cos_incidence);
  }
  return out;
}

/// Where every row lies on its target.
std::vector<model::RoughSurfaces::Place> places_of(const MeanModel& model) {
  std::vector<model::RoughSurfaces::Place> places;
  for (Index i = 0; i < model.rows(); ++i) {
    const Circumstances& at = model.cell(i).at;
    const double weight = 1 / model.sigma_of_mean(i);
    places.push_back(
        {at.target, model.cell(i).group, at.along_mm, weight, weight * range_per_mm_out(at.cos_incidence)});
  }
  return places;
}

/// Means of cells: normal around the predicted range, what a group has in common included.
class Means final : public model::NormalRows {
 public:
  Means(const Reduced& reduced, const MeanNoise& noise)
      : own_(merged(reduced, numbers::search_rows)), model_(own_, noise) {
    for (const auto& run : taken_together(reduced, numbers::search_rows)) {
      first_cell_.push_back(cells_.size());
      for (const Cell* cell : run) cells_.push_back({cell->at.range_mm, cell->at.along_mm});
    }
    first_cell_.push_back(cells_.size());
    log_weights_.resize(model_.rows());
    std::vector<Row> rows;
    for (Index i = 0; i < model_.rows(); ++i) {
      log_weights_[i] = -std::log(std::sqrt(2 * pi * model_.variance_of_mean(i)));
      rows.push_back({model_.cell(i).at, model_.group(i).capture, model_.raw_residual()[i]});
    }
    set_rows(std::move(rows));
    Columns base = base_columns(model_, Hypothesis(own_.bench)).all;
    base.append(of_uneven_surfaces(model_));
    set_base(std::move(base));
    add_rough_surfaces();
    set_log_scale(log_weights_.sum());
  }

  [[nodiscard]] double response(Index row, const Effect& effect) const override {
    const double mm = model_.response(row, effect);
    return std::isfinite(mm) ? mm : 0;
  }
  [[nodiscard]] std::span<const model::CellOfRow> cells_of(Index row) const override {
    const auto i = static_cast<std::size_t>(row);
    return {cells_.data() + first_cell_[i], first_cell_[i + 1] - first_cell_[i]};
  }
  [[nodiscard]] Eigen::VectorXd log_likelihoods(const Eigen::VectorXd& eta) const override {
    return log_weights_ - 0.5 * white_residual(eta).cwiseAbs2();
  }
  [[nodiscard]] Eigen::VectorXd information(const Eigen::VectorXd&) const override { return information_; }
  [[nodiscard]] Eigen::MatrixXd whitened(Eigen::MatrixXd columns, const Eigen::VectorXd&) const override {
    if (!rough_) return model_.whitened(std::move(columns));
    Eigen::MatrixXd white = model_.divided_by_own_noise(std::move(columns));
    rough_->whiten(white);
    if (shared_) shared_->whiten(white);
    return white;
  }
  [[nodiscard]] Eigen::VectorXd white_residual(const Eigen::VectorXd& eta) const override {
    return whitened(model_.raw_residual() - eta, {});
  }
  [[nodiscard]] std::string note(const Eigen::VectorXd&, const Eigen::VectorXd& after) const override {
    if (!rough_) return {};
    const std::map<int, double> odd = surfaces_beside(after).odd;
    std::string list;
    for (const auto& [target, step_mm] : rough_->steps_mm())
      if (step_mm >= numbers::rough_within * numbers::rough_mm && !odd.contains(target))
        list += (list.empty() ? "'" : ", '") + own_.bench.target_at(target).name + "' " +
                rounded(step_mm, 2) + " mm";
    if (list.empty()) return {};
    return "Targets are rough: places a metre apart differ by " + list +
           " (standard deviation). What is smaller on one target is told from its shape only where others "
           "show it as well.";
  }
  [[nodiscard]] std::vector<Unexplained> unexplained(const Eigen::VectorXd& eta) const override {
    std::vector<Unexplained> list;
    if (!rough_) return list;
    const model::LikeliestSurfaces beside = surfaces_beside(eta);
    for (const auto& [target, gain] : beside.odd) {
      Unexplained u;
      u.coordinate = Coordinate::target;
      u.describes = "target '" + own_.bench.target_at(target).name +
                    "' is rougher than it should be: places a metre apart differ by " +
                    rounded(beside.surfaces.steps_mm().at(target), 2) + " mm (standard deviation)";
      u.gain = gain;
      u.from = u.to = target;
      list.push_back(std::move(u));
    }
    return list;
  }

 private:
  /// What is left of surfaces where formulas may deviate, too.
  [[nodiscard]] model::LikeliestSurfaces surfaces_beside(const Eigen::VectorXd& eta) const {
    return model::likeliest_surfaces(places_of(model_), model_.whitened(model_.raw_residual() - eta));
  }
  /// Places go across groups: with errors that groups share besides, these are divided out behind them, all
  /// at once. Where they are too many for that, they go first, and nothing is said of places.
  void add_rough_surfaces() {
    constexpr Index most_shared = 100;
    Eigen::MatrixXd shared = model_.shared_errors();
    Eigen::VectorXd variances = Eigen::VectorXd::Ones(rows()) + shared.rowwise().squaredNorm();
    if (shared.cols() <= most_shared) divide_out_places(variances, shared);
    information_.resize(rows());
    for (Index i = 0; i < information_.size(); ++i)
      information_[i] = 1 / (variances[i] * model_.variance_of_mean(i));
  }
  void divide_out_places(Eigen::VectorXd& variances, Eigen::MatrixXd& shared) {
    const auto places = places_of(model_);
    rough_ = surfaces_beside(Eigen::VectorXd::Zero(rows())).surfaces;
    for (Index i = 0; i < rows(); ++i)
      variances[i] += rough_->variance_mm2(places[static_cast<std::size_t>(i)].target) *
                      std::pow(places[static_cast<std::size_t>(i)].slope, 2);
    rough_->whiten(shared);
    if (shared.cols() > 0) shared_.emplace(0, std::move(shared));
    log_weights_.array() -= rough_->log_determinant() / (2 * static_cast<double>(model_.rows()));
  }

  Reduced own_;  ///< Neighbouring cells of a large session together.
  MeanModel model_;
  std::vector<model::CellOfRow> cells_;  ///< Of all rows.
  std::vector<std::size_t> first_cell_;
  Eigen::VectorXd log_weights_;
  Eigen::VectorXd information_;  ///< Of rows by themselves, with what they share.
  std::optional<model::RoughSurfaces> rough_;
  std::optional<model::SharedErrors> shared_;  ///< Behind rough surfaces.
};

}  // namespace

model::ChannelKind make_mean() {
  model::ChannelKind kind;
  kind.id = "mean";
  kind.observable = Observable::range_mean;
  kind.of_predicted = true;
  kind.rows = [](const Reduced& reduced, const MeanNoise& noise) -> std::unique_ptr<model::ChannelRows> {
    if (reduced.usable_cells() == 0) return nullptr;
    return std::make_unique<Means>(reduced, noise);
  };
  return kind;
}

}  // namespace fit::explain::channels
