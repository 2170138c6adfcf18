// SPDX-License-Identifier: MIT
#include <map>

#include "fit/explain/model/gamma.hpp"
#include "fit/explain/model/scans.hpp"

namespace fit::explain::channels {
namespace {

using model::IndependentRows;

/// By how much whole scans of a capture scatter beside what repeats, in range and in angle: a gamma
/// distribution around the variance that their samples' noise leaves them, to which ranges and angles add
/// that every scan draws anew.
class CommonOfScans final : public model::GammaRows {
 public:
  CommonOfScans(std::vector<Row> rows, std::vector<double> of_samples, std::vector<bool> of_angle,
                bool had_a_wave)
      : GammaRows(std::move(rows), 1e-6), of_samples_(std::move(of_samples)), of_angle_(std::move(of_angle)) {
    constexpr double independent = 0.05;  // to which beams side by side are
    model::Columns base;
    base.columns = Eigen::Map<const Eigen::VectorXd>(of_samples_.data(), this->CommonOfScans::rows());
    base.prior = {Eigen::VectorXd::Zero(1), Eigen::VectorXd::Constant(1, independent)};
    if (had_a_wave) add_rest_of_wave(base);
    set_base(std::move(base));
  }
  [[nodiscard]] bool sees(Coordinate) const override { return true; }
  [[nodiscard]] double response(Eigen::Index row, const Effect& effect) const override {
    return of(row).lever2 * effect.scan_angle_variance_rad2 +
           (of_angle_[static_cast<std::size_t>(row)] ? 0 : effect.scan_range_variance_mm2);
  }
  [[nodiscard]] double offset(Eigen::Index row) const override {
    return of_samples_[static_cast<std::size_t>(row)];
  }

 private:
  /// A wave that was taken off leaves something in ranges and in angles alike: it is as large as noise, and
  /// depends on no lever.
  void add_rest_of_wave(model::Columns& base) const {
    const double typical_mm2 = base.columns.mean();
    base.columns.conservativeResize(Eigen::NoChange, 3);
    for (Eigen::Index i = 0; i < base.columns.rows(); ++i)
      for (const bool angle : {false, true})
        base.columns(i, angle ? 2 : 1) = of_angle_[static_cast<std::size_t>(i)] == angle ? 1 : 0;
    base.prior.mean = Eigen::VectorXd::Zero(3);
    base.prior.sigma.conservativeResize(3);
    base.prior.sigma.tail(2).setConstant(typical_mm2);
  }

  std::vector<double> of_samples_;  ///< What their noise leaves a whole scan, mm^2.
  std::vector<bool> of_angle_;
};

}  // namespace

model::ChannelKind make_common() {
  model::ChannelKind kind;
  kind.id = "common";
  kind.observable = Observable::range_variance;
  kind.shows = "what a whole scan is off by, standard deviation";
  kind.unit = "mm";
  kind.is_square = true;
  kind.rows = [](const Reduced& reduced, const MeanNoise&) -> std::unique_ptr<model::ChannelRows> {
    struct Sums {
      IndependentRows::Row row;
      double noise = 0, number = 0;
    };
    std::map<std::pair<int, bool>, Sums> by_capture;
    for (const model::ScanPart& p : model::scan_parts(reduced, 3, 1)) {
      Sums& s = by_capture[{p.capture, p.of_angle}];
      s.row.at = p.at;
      s.row.capture = p.capture;
      s.row.y += p.rest_mm * p.rest_mm;
      s.row.n += p.news;
      s.row.lever2 += p.lever_mm * p.lever_mm;
      s.noise += p.variance_mm2;
      s.number += 1;
    }
    std::vector<IndependentRows::Row> rows;
    std::vector<double> noise;
    std::vector<bool> of_angle;
    for (auto& [key, s] : by_capture) {
      if (s.row.n < 1) continue;
      s.row.y /= s.row.n;
      s.row.lever2 /= s.number;
      rows.push_back(s.row);
      noise.push_back(s.noise / s.number);
      of_angle.push_back(key.second);
    }
    if (rows.empty()) return nullptr;
    return std::make_unique<CommonOfScans>(std::move(rows), std::move(noise), std::move(of_angle),
                                           reduced.wave_hz.has_value());
  };
  return kind;
}

}  // namespace fit::explain::channels
