// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/explain/inference/numbers.hpp"
#include "fit/explain/model/channel.hpp"

namespace fit::explain::channels {
namespace {

using Eigen::Index;

/// Deviations of single cells from the mean of those that are taken together in one row of the means: normal,
/// independent but for that mean. Smooth effects are the same in all of them.
class Fine final : public model::ChannelRows {
 public:
  struct Run {
    std::vector<const Cell*> cells;
    int capture = 0;
  };
  Fine(const std::vector<Run>& runs, const MeanNoise& noise) {
    for (const Run& run : runs) {
      for (const Cell* cell : run.cells) {
        at_.push_back(cell->at);
        capture_.push_back(run.capture);
        off_.push_back(cell->mean_mm - cell->nominal_mm);
        root_.push_back(1 / std::sqrt(variance_of_mean(*cell, noise)));
      }
      ends_.push_back(at_.size());
    }
    base_.columns.resize(rows(), 0);
    white_ = whitened(Eigen::Map<const Eigen::VectorXd>(off_.data(), rows()), {});
  }

  [[nodiscard]] Index rows() const override { return std::ssize(at_); }
  [[nodiscard]] const Circumstances& at(Index row) const override { return at_[place(row)]; }
  [[nodiscard]] int capture(Index row) const override { return capture_[place(row)]; }
  [[nodiscard]] double response(Index, const Effect& effect) const override { return effect.range_mm; }
  [[nodiscard]] bool sees_only_combs() const override { return true; }
  [[nodiscard]] const model::Columns& base() const override { return base_; }
  [[nodiscard]] double offset(Index) const override { return 0; }
  [[nodiscard]] double statistic(Index row) const override { return off_[place(row)]; }
  [[nodiscard]] double log_likelihood(const Eigen::VectorXd& eta) const override {
    return -0.5 * white_residual(eta).squaredNorm();
  }
  [[nodiscard]] Eigen::VectorXd log_likelihoods(const Eigen::VectorXd& eta) const override {
    return -0.5 * white_residual(eta).cwiseAbs2();
  }
  [[nodiscard]] bool has_fixed_information() const override { return true; }
  [[nodiscard]] Eigen::MatrixXd whitened(Eigen::MatrixXd columns, const Eigen::VectorXd&) const override {
    for (Index k = 0; k < columns.cols(); ++k) {
      std::size_t i = 0;
      for (const std::size_t end : ends_) {
        double sum = 0, weight = 0;
        for (std::size_t j = i; j < end; ++j) {
          sum += root_[j] * root_[j] * columns(static_cast<Index>(j), k);
          weight += root_[j] * root_[j];
        }
        for (; i < end; ++i) {
          double& value = columns(static_cast<Index>(i), k);
          value = root_[i] * (value - sum / weight);
        }
      }
    }
    return columns;
  }
  [[nodiscard]] Eigen::VectorXd white_residual(const Eigen::VectorXd& eta) const override {
    return eta.isZero(0) ? white_ : Eigen::VectorXd(white_ - whitened(eta, eta));
  }
  [[nodiscard]] Eigen::VectorXd score(const Eigen::VectorXd& eta) const override {
    return white_residual(eta).cwiseProduct(Eigen::Map<const Eigen::VectorXd>(root_.data(), rows()));
  }

 private:
  static std::size_t place(Index row) { return static_cast<std::size_t>(row); }

  std::vector<Circumstances> at_;
  std::vector<int> capture_;
  std::vector<double> off_, root_;  ///< Deviation, and one over its standard deviation.
  std::vector<std::size_t> ends_;   ///< Of the runs.
  Eigen::VectorXd white_;
  model::Columns base_;
};

}  // namespace

model::ChannelKind make_fine() {
  model::ChannelKind kind;
  kind.id = "fine";
  kind.observable = Observable::range_mean;
  kind.of_predicted = true;
  kind.has_forms = false;
  kind.rows = [](const Reduced& reduced, const MeanNoise& noise) -> std::unique_ptr<model::ChannelRows> {
    constexpr std::size_t most_cells = 50'000;
    if (reduced.output_step_mm > 1) return nullptr;  // coarse steps are a comb of their own
    const SearchRows search(reduced, true, numbers::search_rows);
    std::vector<Fine::Run> runs;
    std::size_t cells = 0;
    for (std::size_t g = 0; g < reduced.groups.size(); ++g)
      for (auto& run : taken_together(reduced, search, g)) {
        if (run.size() < 2) continue;
        cells += run.size();
        runs.push_back({std::move(run), reduced.groups[g].capture});
      }
    if (runs.empty()) return nullptr;
    const std::size_t every = (cells + most_cells - 1) / most_cells;
    std::vector<Fine::Run> kept;
    for (std::size_t i = 0; i < runs.size(); i += every) kept.push_back(std::move(runs[i]));
    return std::make_unique<Fine>(kept, noise);
  };
  return kind;
}

}  // namespace fit::explain::channels
