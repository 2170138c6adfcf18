// SPDX-License-Identifier: MIT
#include <algorithm>

#include "fit/explain/model/counts.hpp"
#include "fit/explain/model/transitions.hpp"
#include "fit/explain/numbers.hpp"

namespace fit::explain::channels {
namespace {

/// Samples beside an edge that lie between the two surfaces, on neither. Beams that meet both at once do
/// that, as often as it was seen on the whole, for no width says how often: whatever the predictor comes to
/// beyond that is that. Strays lie there as often as anywhere.
class Blends final : public model::Counts {
 public:
  Blends(std::vector<Row> rows, std::vector<double> shares)
      : Counts(std::move(rows)), shares_(std::move(shares)), blended_(hazard(on_the_whole())) {}
  [[nodiscard]] double response(Eigen::Index row, const Effect& effect) const override {
    constexpr double hardly_wide_rad = 0.01 * rad_per_deg, most = 5;  // a fit may take a fifth of the width
    const double wide = std::min(most, effect.footprint_rad / hardly_wide_rad);
    return wide * wide * blended_ + shares_[static_cast<std::size_t>(row)] * hazard(effect.stray);
  }
  [[nodiscard]] double offset(Eigen::Index) const override { return numbers::tail_hazard; }
  /// Beyond the most that blending makes there is no curvature.
  [[nodiscard]] Eigen::VectorXd expansion_for_last_steps(Eigen::VectorXd eta) const override {
    return expansion_for_steps(std::move(eta));
  }

 protected:
  [[nodiscard]] double log_likelihood(Eigen::Index row, double eta) const override {
    return Counts::log_likelihood(row, std::min(eta, blended_));
  }
  [[nodiscard]] double score(Eigen::Index row, double eta) const override {
    return eta < blended_ ? Counts::score(row, eta) : 0;
  }
  [[nodiscard]] double information(Eigen::Index row, double eta) const override {
    constexpr double hardly_any = 1e-9;
    return eta < blended_ ? Counts::information(row, eta) : hardly_any;
  }

 private:
  std::vector<double> shares_;  ///< Of all places where strays may lie.
  double blended_;              ///< Hazard on the whole.
};

double room_of_strays_mm(const Reduced& reduced) {
  if (reduced.strays_mm.empty()) return 1;
  const auto [nearest, farthest] = std::ranges::minmax(reduced.strays_mm);
  return std::max(1.0F, farthest - nearest);
}

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
    const double room_mm = room_of_strays_mm(reduced);
    std::vector<model::IndependentRows::Row> rows;
    std::vector<double> shares;
    for (const model::Transition& edge : model::transitions(reduced)) {
      const int target = edge.edge / 2;                     // as fit/bench/scene.hpp counts them
      if (reduced.bench.target_at(target).round) continue;  // its sides lie anywhere between
      const auto [between, samples] = edge.shared();
      if (samples == 0) continue;
      rows.push_back({.at = edge.at, .capture = edge.capture, .y = between, .n = samples});
      shares.push_back(std::min(1.0, edge.at.gap_mm / room_mm));
    }
    if (rows.empty()) return nullptr;
    return std::make_unique<Blends>(std::move(rows), std::move(shares));
  };
  return kind;
}

}  // namespace fit::explain::channels
