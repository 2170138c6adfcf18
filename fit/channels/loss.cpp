// SPDX-License-Identifier: MIT
#include <algorithm>

#include "fit/explain/model/counts.hpp"
#include "fit/explain/model/sure_hits.hpp"

namespace fit::explain::channels {
namespace {

class Losses final : public model::Counts {
 public:
  explicit Losses(std::vector<Row> rows) : Counts(std::move(rows)) {}
  [[nodiscard]] double response(Eigen::Index, const Effect& effect) const override {
    return hazard(effect.lost);
  }
};

/// Cells of which nothing came back are darker than the darkest that was seen: half as bright.
void darken(std::vector<model::IndependentRows::Row>& rows) {
  double darkest = std::numeric_limits<double>::infinity();
  for (const auto& row : rows)
    if (std::isfinite(row.at.intensity)) darkest = std::min(darkest, row.at.intensity);
  if (!std::isfinite(darkest)) return;
  for (auto& row : rows)
    if (!std::isfinite(row.at.intensity)) row.at.intensity = darkest / 2;
}

}  // namespace

model::ChannelKind make_loss() {
  model::ChannelKind kind;
  kind.id = "loss";
  kind.observable = Observable::dropout;
  kind.shows = "share of lost echoes";
  kind.rows = [](const Reduced& reduced, const MeanNoise&) -> std::unique_ptr<model::ChannelRows> {
    constexpr int beams = 4;
    constexpr double enough = 50;  // samples: a threshold's flank may be narrower than the next beam's echo
    constexpr double grazing_rad = 75 * rad_per_deg;
    auto rows = model::pooled_rows(reduced, beams, [&](std::size_t i, auto& row) {
      const Cell& cell = reduced.cells[i];
      if (cell.n + cell.lost == 0 || std::abs(cell.at.incidence_rad) > grazing_rad ||
          model::may_miss_its_target(reduced, i, false))
        return false;
      row.y += cell.lost;
      row.n += cell.n + cell.stray + cell.lost;
      return true;
    }, enough);
    darken(rows);
    if (rows.empty()) return nullptr;
    return std::make_unique<Losses>(std::move(rows));
  };
  return kind;
}

}  // namespace fit::explain::channels
