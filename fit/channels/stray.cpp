// SPDX-License-Identifier: MIT
#include <algorithm>
#include <array>

#include "fit/explain/model/counts.hpp"

namespace fit::explain::channels {
namespace {

enum class Side { far, late, early };

/// Strays of the same samples, far from their target and close to it on either side. What lies anywhere lies
/// close as often as that is a part of all places where strays may lie.
class Strays final : public model::Counts {
 public:
  Strays(std::vector<Row> rows, std::vector<Side> sides, std::vector<double> shares)
      : Counts(std::move(rows)), sides_(std::move(sides)), shares_(std::move(shares)) {
    Columns base;  // a tail of the noise ends close to the target; a rare stray may lie anywhere
    base.columns.resize(this->Strays::rows(), 2);
    for (Eigen::Index i = 0; i < this->Strays::rows(); ++i) {
      const auto row = static_cast<std::size_t>(i);
      base.columns.row(i) << (sides_[row] == Side::far ? 0 : 1), shares_[row];
    }
    base.prior = Prior::around_zero(2);
    base.prior.sigma << numbers::tail_hazard, numbers::stray_hazard;
    set_base(std::move(base));
  }
  [[nodiscard]] double response(Eigen::Index row, const Effect& effect) const override {
    const auto i = static_cast<std::size_t>(row);
    const double tail = sides_[i] == Side::late ? effect.late : sides_[i] == Side::early ? effect.early : 0;
    return shares_[i] * hazard(effect.stray) + hazard(tail);
  }

 private:
  std::vector<Side> sides_;
  std::vector<double> shares_;  ///< Of all places where strays may lie.
};

/// From the nearest stray to the target, and beyond it as far as any stray was seen beyond its own.
struct Places {
  double from_mm = 60, to_mm = 0;

  explicit Places(const Reduced& reduced) {
    for (std::size_t i = 0; i < reduced.strays_mm.size(); ++i) {
      const double mm = reduced.strays_mm[i];
      from_mm = std::min(from_mm, mm);
      if (reduced.strays_of_target[i] > 1) to_mm = std::max(to_mm, mm);
    }
  }
  /// Of what is counted there; among a target's own samples nobody counts strays.
  [[nodiscard]] double share(Side side, double at_mm, const Reach& reach) const {
    const double beyond = std::max(0.0, to_mm - at_mm), before = at_mm - from_mm;
    const auto within = [](double room, double from, double to) { return std::clamp(room, from, to) - from; };
    const double of = side == Side::late ? within(beyond, reach.too_far_mm, reach.close_mm)
                      : side == Side::early
                          ? within(before, reach.too_far_mm, reach.close_mm)
                          : std::max(0.0, beyond - reach.close_mm) + std::max(0.0, before - reach.close_mm);
    return std::clamp(of / std::max(1.0, beyond + before), 0.001, 1.0);
  }
};

std::vector<model::IndependentRows::Row> rows_of(const Reduced& reduced, Side side) {
  constexpr int beams = 8, fewest_scans = 4;
  constexpr double reach_of_edge_rad = 1.2 * rad_per_deg;  // a wide beam meets what stands behind an edge
  return model::counted_rows(reduced, beams, [&](std::size_t i, auto& row) {
    const Cell& cell = reduced.cells[i];
    if (!cell.usable || reduced.group_of(cell).scans < fewest_scans) return false;
    if (cell.at.gap_mm != 0 && std::abs(cell.at.edge_rad) < reach_of_edge_rad) return false;
    row.y += side == Side::far    ? cell.far - cell.late - cell.early
             : side == Side::late ? cell.late
                                  : cell.early;
    row.expected = reduced.group_of(cell).sigma_mm;
    row.n += cell.n + cell.stray;
    return true;
  });
}

}  // namespace

model::ChannelKind make_stray() {
  model::ChannelKind kind;
  kind.id = "stray";
  kind.observable = Observable::range_distribution;
  kind.shows = "share of samples far off";
  kind.rows = [](const Reduced& reduced, const MeanNoise&) -> std::unique_ptr<model::ChannelRows> {
    const Places places(reduced);
    std::vector<model::IndependentRows::Row> rows;
    std::vector<Side> sides;
    std::vector<double> shares;
    for (const Side side : {Side::far, Side::late, Side::early})
      for (const auto& row : rows_of(reduced, side)) {
        rows.push_back(row);
        sides.push_back(side);
        shares.push_back(places.share(side, row.at.range_mm, Reach(row.expected)));
      }
    if (rows.empty()) return nullptr;
    return std::make_unique<Strays>(std::move(rows), std::move(sides), std::move(shares));
  };
  return kind;
}

}  // namespace fit::explain::channels
