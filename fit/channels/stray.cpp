// SPDX-License-Identifier: MIT
#include "fit/explain/model/counts.hpp"

namespace fit::explain::channels {
namespace {

class Strays final : public model::Counts {
 public:
  explicit Strays(std::vector<Row> rows) : Counts(std::move(rows)) {}
  [[nodiscard]] double response(Eigen::Index, const Effect& effect) const override {
    return hazard(effect.stray);
  }
};

}  // namespace

model::ChannelKind make_stray() {
  model::ChannelKind kind;
  kind.id = "stray";
  kind.observable = Observable::range_distribution;
  kind.shows = "share of samples far off";
  kind.rows = [](const Reduced& reduced, const MeanNoise&) -> std::unique_ptr<model::ChannelRows> {
    constexpr int beams = 8, fewest_scans = 4;
    constexpr double reach_of_edge_rad = 1.2 * rad_per_deg;  // a wide beam meets what stands behind an edge
    auto rows = model::pooled_rows(reduced, beams, [&](std::size_t i, auto& row) {
      const Cell& cell = reduced.cells[i];
      if (!cell.smooth || reduced.groups[static_cast<std::size_t>(cell.group)].scans < fewest_scans) return false;
      if (cell.at.gap_mm != 0 && std::abs(cell.at.edge_rad) < reach_of_edge_rad) return false;
      // Those among the target's own samples are as many as fell just beside these.
      row.y += cell.far + cell.beside;
      row.n += cell.n + cell.stray;
      return true;
    });
    if (rows.empty()) return nullptr;
    return std::make_unique<Strays>(std::move(rows));
  };
  return kind;
}

}  // namespace fit::explain::channels
