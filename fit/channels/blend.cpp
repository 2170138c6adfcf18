// SPDX-License-Identifier: MIT
#include <algorithm>

#include "fit/explain/inference/numbers.hpp"
#include "fit/explain/model/counts.hpp"
#include "fit/explain/model/transitions.hpp"

namespace fit::explain::channels {
namespace {

/// Samples beside an edge that lie between the two surfaces, on neither. Only a beam that meets both at once
/// does that; receivers that keep two echoes apart never show one, so that none says nothing.
class Blends final : public model::Counts {
 public:
  explicit Blends(std::vector<Row> rows) : Counts(std::move(rows)) {}
  [[nodiscard]] double response(Eigen::Index, const Effect& effect) const override {
    constexpr double hardly_wide_rad = 0.01 * rad_per_deg;
    const double wide = effect.footprint_rad / hardly_wide_rad;
    return wide * wide + hazard(effect.stray);
  }
  [[nodiscard]] double offset(Eigen::Index) const override { return numbers::tail_hazard; }
};

}  // namespace

model::ChannelKind make_blend() {
  model::ChannelKind kind;
  kind.id = "blend";
  kind.observable = Observable::range_distribution;
  kind.has_forms = false;
  kind.shows = "share of samples between two surfaces, where there are any";
  kind.rows = [](const Reduced& reduced, const MeanNoise&) -> std::unique_ptr<model::ChannelRows> {
    if (std::ranges::none_of(reduced.cells, [](const Cell& cell) { return cell.between > 0; }))
      return nullptr;
    std::vector<model::IndependentRows::Row> rows;
    for (const model::Transition& edge : model::transitions(reduced)) {
      const double between = edge.between();
      if (between == 0) continue;
      model::IndependentRows::Row row;
      row.at = edge.at();
      row.capture = edge.capture();
      row.y = row.n = between;
      rows.push_back(row);
    }
    if (rows.empty()) return nullptr;
    return std::make_unique<Blends>(std::move(rows));
  };
  return kind;
}

}  // namespace fit::explain::channels
