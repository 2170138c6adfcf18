// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/explain/model/block_means.hpp"
#include "fit/explain/model/channel.hpp"
#include "fit/explain/numbers.hpp"

namespace fit::explain::channels {
namespace {

using Eigen::Index;

/// Deviations of single cells from the mean of those that are taken together in one row of the means: normal,
/// independent but for that mean. Smooth effects are the same in all of them.
class Fine final : public model::NormalRows {
 public:
  Fine(const Reduced& reduced, const std::vector<std::vector<const Cell*>>& runs, const MeanNoise& noise) {
    std::vector<double> weight, off;
    std::vector<Row> rows;
    for (const auto& run : runs) {
      std::vector<Index>& block = means_.blocks.emplace_back();
      for (const Cell* cell : run) {
        block.push_back(std::ssize(rows));
        off.push_back(cell->off_mm());
        rows.push_back({cell->at, reduced.group_of(*cell).capture, off.back()});
        weight.push_back(1 / std::sqrt(variance_of_mean(*cell, noise)));
      }
    }
    const Index count = std::ssize(rows);
    set_rows(std::move(rows));
    means_.weight = Eigen::Map<const Eigen::VectorXd>(weight.data(), count);
    white_ = whitened(Eigen::Map<const Eigen::VectorXd>(off.data(), count), {});
  }

  [[nodiscard]] double response(Index, const Effect& effect) const override { return effect.range_mm; }
  [[nodiscard]] bool sees_only_combs() const override { return true; }
  [[nodiscard]] Eigen::MatrixXd whitened(Eigen::MatrixXd columns, const Eigen::VectorXd&) const override {
    means_.whiten(columns);
    return columns;
  }
  [[nodiscard]] Eigen::VectorXd white_residual(const Eigen::VectorXd& eta) const override {
    return eta.isZero(0) ? white_ : Eigen::VectorXd(white_ - whitened(eta, eta));
  }
  [[nodiscard]] Eigen::VectorXd score(const Eigen::VectorXd& eta) const override {
    return white_residual(eta).cwiseProduct(means_.weight);
  }

 private:
  model::BlockMeans means_;  ///< Of the rows of the means.
  Eigen::VectorXd white_;
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
    if (reduced.output_steps.step_mm > 1) return nullptr;  // coarse steps are a comb of their own
    std::vector<std::vector<const Cell*>> runs = taken_together(reduced, numbers::search_rows);
    std::erase_if(runs, [](const auto& run) { return run.size() < 2; });
    if (runs.empty()) return nullptr;
    std::size_t cells = 0;
    for (const auto& run : runs) cells += run.size();
    const std::size_t every = (cells + most_cells - 1) / most_cells;
    std::vector<std::vector<const Cell*>> kept;
    for (std::size_t i = 0; i < runs.size(); i += every) kept.push_back(std::move(runs[i]));
    return std::make_unique<Fine>(reduced, kept, noise);
  };
  return kind;
}

}  // namespace fit::explain::channels
