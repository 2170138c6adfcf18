// SPDX-License-Identifier: MIT
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "fit/explain/model/counts.hpp"
#include "fit/explain/numbers.hpp"
#include "fit/explain/reduction/expected_echo.hpp"
#include "fit/explain/reduction/margins.hpp"
#include "fit/numeric/angle.hpp"

namespace fit::explain::channels {
namespace {

constexpr double doubt_rad = 1.5 * rad_per_deg, widest_slit_rad = 6 * rad_per_deg;
/// By how much a target may stand aside from where it is said to stand.
constexpr double aside_rad = 6 * rad_per_deg;

/// Where walls meet they leave a slit if they stand off or turned.
bool is_at_corner(const Reduced& reduced, const Cell& cell, double blur_rad) {
  const double place_uncertainty_mm = reduction::place_uncertainty_mm(
                   reduced.bench.lidar.mount, cell.sight.range_mm, reduction::coverage_of_mount),
               half_rad = reduction::half_width_rad(cell) + blur_rad;
  return cell.at.corner_mm < reduction::corner_margin_mm(cell.sight, place_uncertainty_mm, half_rad);
}

/// Without any echo where one target ends and another begins: one that stands turned leaves a slit there.
bool may_be_a_slit(const Reduced& reduced, std::size_t index) {
  const Cell& cell = reduced.cells[index];
  if (cell.n > 0) return false;
  const auto cells = reduced.cells_of(reduced.group_of(cell));
  const Cell *below = nullptr, *above = nullptr;  // the nearest that see something
  for (const Cell& other : cells) {
    if (other.n == 0) continue;
    if (other.beam_rad < cell.beam_rad)
      below = &other;
    else if (!above)
      above = &other;
  }
  if (!below || !above || above->beam_rad - below->beam_rad > widest_slit_rad) return false;
  return std::ranges::any_of(cells, [&](const Cell& other) {
    return other.n > 0 && other.sight.target != cell.sight.target &&
           other.beam_rad > below->beam_rad - doubt_rad && other.beam_rad < above->beam_rad + doubt_rad;
  });
}

/// Whether the beam of a cell may go past its target, so that a missing echo tells nothing: at a corner, or
/// near an edge, unless its neighbours on both sides, farther than edges blur, see the target as well.
bool may_miss_its_target(const Reduced& reduced, std::size_t index) {
  constexpr double blur_rad = 0.5 * rad_per_deg;
  const Cell& cell = reduced.cells[index];
  const double to_edge = std::abs(cell.at.edge_rad);
  if (to_edge < blur_rad || is_at_corner(reduced, cell, blur_rad) || may_be_a_slit(reduced, index))
    return true;
  // Nearer than `doubt_rad` to an edge its neighbours must see the target, on both sides; a beam without any
  // echo from farther inside needs only something of the target on both sides.
  const bool near = to_edge < doubt_rad;
  if (!near && (cell.n > 0 || to_edge > aside_rad)) return false;
  const double from = near ? blur_rad : 0, to = near ? 2 * blur_rad : aside_rad;
  const auto sees_it = [&](const Cell& other) {
    return other.sight.target == cell.sight.target && 2 * other.n > other.n + other.stray + other.lost;
  };
  bool below = false, above = false;
  for (const Cell& other : reduced.cells_of(reduced.group_of(cell))) {
    const double away = other.beam_rad - cell.beam_rad;
    if (std::abs(away) < from || std::abs(away) > to || !sees_it(other)) continue;
    (away < 0 ? below : above) = true;
  }
  return !below || !above;
}

class Losses final : public model::Counts {
 public:
  explicit Losses(std::vector<Row> rows) : Counts(std::move(rows)) {
    set_base({Eigen::MatrixXd::Ones(this->Losses::rows(), 1),
              {Eigen::VectorXd::Zero(1), Eigen::VectorXd::Constant(1, numbers::hazard_of_losses)}});
  }
  [[nodiscard]] double response(Eigen::Index, const Effect& effect) const override {
    return hazard(effect.lost);
  }
};

/// Where nothing came back the echo is as strong as the others make it expected, and no stronger than the
/// weakest of them.
void expect_lost_echoes(std::vector<model::IndependentRows::Row>& rows) {
  std::vector<const Circumstances*> known;
  for (const auto& row : rows)
    if (row.at.intensity > 0) known.push_back(&row.at);
  if (known.empty()) return;
  const reduction::ExpectedEcho expected(known);
  const double weakest = (*std::ranges::min_element(known, {}, &Circumstances::intensity))->intensity;
  for (auto& row : rows)
    if (!std::isfinite(row.at.intensity)) row.at.intensity = std::min(weakest, expected(row.at));
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
    constexpr double grazing_rad = 85 * rad_per_deg;
    auto rows = model::counted_rows(
        reduced, beams,
        [&](std::size_t i, auto& row) {
          const Cell& cell = reduced.cells[i];
          if (cell.n + cell.lost == 0 || std::abs(cell.at.incidence_rad) > grazing_rad ||
              may_miss_its_target(reduced, i))
            return false;
          row.y += cell.lost;
          row.n += cell.n + cell.stray + cell.lost;
          return true;
        },
        enough);
    expect_lost_echoes(rows);
    if (rows.empty()) return nullptr;
    return std::make_unique<Losses>(std::move(rows));
  };
  return kind;
}

}  // namespace fit::explain::channels
