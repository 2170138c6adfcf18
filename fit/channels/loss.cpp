// SPDX-License-Identifier: MIT
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "fit/explain/model/counts.hpp"
#include "fit/explain/model/near_edges.hpp"
#include "fit/explain/numbers.hpp"

namespace fit::explain::channels {
namespace {

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

/// How strong an echo is expected, by the echoes that came back: a power of the range, of the incidence's
/// cosine and of the surface's reflectance (the radar equation, with exponents of this receiver).
class ExpectedEcho {
 public:
  ExpectedEcho(const Reduced& reduced, const std::vector<model::IndependentRows::Row>& rows)
      : reduced_(reduced) {
    Eigen::Matrix4d square =
        Eigen::Vector4d(1e-9, 1, 1, 1).asDiagonal();  // exponents near those of a plain receiver
    Eigen::Vector4d along = square * Eigen::Vector4d(0, -2, 1, 1);
    for (const auto& row : rows) {
      if (!(row.at.intensity > 0)) continue;
      const Eigen::Vector4d x = powers(row);
      square += x * x.transpose();
      along += x * std::log(row.at.intensity);
      darkest_ = std::min(darkest_, row.at.intensity);
    }
    exponents_ = square.ldlt().solve(along);
  }
  /// Not brighter than what did come back; NaN where nothing ever did.
  [[nodiscard]] double operator()(const model::IndependentRows::Row& row) const {
    return std::isfinite(darkest_) ? std::min(darkest_, std::exp(exponents_.dot(powers(row))))
                                   : row.at.intensity;
  }

 private:
  [[nodiscard]] Eigen::Vector4d powers(const model::IndependentRows::Row& row) const {
    const double reflectance = reflectance_in(reduced_.captures[static_cast<std::size_t>(row.capture)],
                                              reduced_.bench.target_at(row.at.target));
    return {1, std::log(std::max(1.0, row.at.range_mm) / 1000),
            std::log(std::max(0.05, row.at.cos_incidence)), std::log(std::max(0.001, reflectance))};
  }

  const Reduced& reduced_;
  double darkest_ = std::numeric_limits<double>::infinity();
  Eigen::Vector4d exponents_ = Eigen::Vector4d::Zero();
};

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
              model::may_miss_its_target(reduced, i))
            return false;
          row.y += cell.lost;
          row.n += cell.n + cell.stray + cell.lost;
          return true;
        },
        enough);
    const ExpectedEcho expected(reduced, rows);
    for (auto& row : rows)
      if (!std::isfinite(row.at.intensity)) row.at.intensity = expected(row);
    if (rows.empty()) return nullptr;
    return std::make_unique<Losses>(std::move(rows));
  };
  return kind;
}

}  // namespace fit::explain::channels
