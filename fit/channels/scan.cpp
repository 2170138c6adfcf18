// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "fit/explain/model/channel.hpp"
#include "fit/explain/model/neighbours.hpp"
#include "fit/explain/model/noise_of_scans.hpp"
#include "fit/explain/model/scans.hpp"
#include "fit/explain/numbers.hpp"

namespace fit::explain::channels {
namespace {

using Eigen::Index;
using model::ScanPart;

/// What scans have in common, against the mean of their capture: normal around what changes from scan to
/// scan.
class Scans final : public model::NormalRows {
 public:
  Scans(std::vector<ScanPart> parts, const model::RandomOfScans& range, const model::RandomOfScans& angle,
        const Reduced& reduced)
      : parts_(std::move(parts)) {
    std::vector<Row> rows_of_parts;
    for (const ScanPart& p : parts_) rows_of_parts.push_back({p.at, p.capture, p.mm});
    set_rows(std::move(rows_of_parts));
    if (reduced.wave_hz) expect_wave(*reduced.wave_hz, true);
    if (reduced.vibration_hz) expect_wave(*reduced.vibration_hz, false);
    for (auto from = parts_.cbegin(); from != parts_.cend();) {
      const auto to = std::find_if(from, parts_.cend(),
                                   [group = from->group](const ScanPart& p) { return p.group != group; });
      noise_.emplace_back(from - parts_.cbegin(), std::span(from, to), range, angle);
      from = to;
    }
  }

  [[nodiscard]] bool sees(Coordinate coordinate) const override { return coordinate == Coordinate::scan_seq; }
  [[nodiscard]] double response(Index row, const Effect& effect) const override {
    return (part(row).of_angle ? 0 : effect.range_mm) + part(row).sensitivity_mm * effect.stage_rad;
  }
  /// Less the mean of their block, which the cells' means have taken.
  [[nodiscard]] Eigen::MatrixXd whitened(Eigen::MatrixXd columns, const Eigen::VectorXd&) const override {
    for (const model::NoiseOfScans& noise : noise_) noise.whiten(columns);
    return columns;
  }
  [[nodiscard]] Eigen::VectorXd information(const Eigen::VectorXd&) const override {
    Eigen::VectorXd of_samples(rows());
    for (Index i = 0; i < rows(); ++i) of_samples[i] = 1 / part(i).variance_mm2;
    return of_samples;
  }

 private:
  /// A wave of that frequency, in no step with captures, has a phase of its own in each. It is one of all
  /// ranges and of the stage's angle; or of a lamp, what is left of one that was taken off.
  void expect_wave(double hz, bool of_lamp) {
    std::map<int, Index> of_group;
    for (const ScanPart& p : parts_) of_group.try_emplace(p.group, static_cast<Index>(of_group.size()));
    constexpr std::size_t most_groups = 60;  // computing time
    if (of_group.size() > most_groups) return;
    Eigen::MatrixXd waves = Eigen::MatrixXd::Zero(rows(), 4 * static_cast<Index>(of_group.size()));
    constexpr double angle_rad =
        numbers::form_deg * rad_per_deg / numbers::form_mm;  // the prior is that of a mm
    for (Index i = 0; i < rows(); ++i) {
      const double turn = 2 * pi * hz * part(i).at.since_move_s, of_range = part(i).of_angle ? 0 : 1,
                   of_angle = of_lamp ? 1 - of_range : part(i).sensitivity_mm * angle_rad;
      const Eigen::RowVector2d wave(std::cos(turn), std::sin(turn));
      waves.row(i).segment<4>(4 * of_group.at(part(i).group)) << of_range * wave, of_angle * wave;
    }
    append_to_base({waves, Prior::around_zero(waves.cols(), numbers::form_mm)});
  }
  [[nodiscard]] const ScanPart& part(Index row) const { return parts_[static_cast<std::size_t>(row)]; }

  std::vector<ScanPart> parts_;
  std::vector<model::NoiseOfScans> noise_;  ///< Of every group.
};

}  // namespace

model::ChannelKind make_scan() {
  model::ChannelKind kind;
  kind.id = "scan";
  kind.observable = Observable::range_mean;
  kind.shows = "range of whole scans";
  kind.unit = "mm";
  kind.rows = [](const Reduced& reduced, const MeanNoise&) -> std::unique_ptr<model::ChannelRows> {
    const double of_neighbours = model::inflation_of_sums(reduced);
    const auto in_parts = [&](int parts) {
      std::vector<ScanPart> list = model::scan_parts(reduced, model::fewest_in_common, parts);
      for (ScanPart& part : list) part.variance_mm2 *= of_neighbours;
      return list;
    };
    const std::vector<ScanPart> whole = in_parts(1);
    if (whole.size() < 10) return nullptr;
    int parts = 1;  // Of a scan, as many as computing time allows.
    while (parts < 8 && 2 * static_cast<std::size_t>(parts) * whole.size() <= 3 * numbers::search_rows)
      parts *= 2;
    return std::make_unique<Scans>(parts == 1 ? whole : in_parts(parts),
                                   model::random_of_scans(reduced, model::scatter_of_scans(whole, false)),
                                   model::random_of_scans(reduced, model::scatter_of_scans(whole, true)),
                                   reduced);
  };
  return kind;
}

}  // namespace fit::explain::channels
