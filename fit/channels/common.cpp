// SPDX-License-Identifier: MIT
#include <map>

#include "fit/explain/model/autoregression.hpp"
#include "fit/explain/model/gamma.hpp"
#include "fit/explain/model/neighbours.hpp"
#include "fit/explain/model/scans.hpp"

namespace fit::explain::channels {
namespace {

using model::IndependentRows;

/// What of a scan a row is about: its range, its angle, or its sectors beside both.
enum class Part { range, angle, sectors };

/// By how much scans of a capture scatter beside what repeats, as a whole and from sector to sector: a gamma
/// distribution around the variance that their samples' noise leaves them. Ranges and angles that every scan
/// draws anew add to the whole; noise that neighbouring beams share multiplies both.
class CommonOfScans final : public model::GammaRows {
 public:
  /// `parts`: what each row is about; what independent noise of the samples makes of it is expected.
  CommonOfScans(std::vector<Row> rows, std::vector<Part> parts, bool had_a_wave)
      : GammaRows(std::move(rows), 1e-6), parts_(std::move(parts)) {
    constexpr double independent = 0.05;  // to which beams side by side are
    Columns base;
    add(base, independent, [this](Eigen::Index row) { return of(row).expected; });
    // What neighbours share may reach beyond a sector, and where it is more it weighs otherwise in each.
    constexpr double otherwise = 0.5;
    if (const double shared = shared_in_sectors(); shared > independent)
      for (const Part part : {Part::range, Part::angle})
        add(base, otherwise * shared,
            [=, this](Eigen::Index row) { return part_of(row) == part ? of(row).expected : 0; });
    if (had_a_wave) add_rest_of_wave(base);
    set_base(std::move(base));
  }
  [[nodiscard]] bool sees(Coordinate) const override { return true; }
  [[nodiscard]] double response(Eigen::Index row, const Effect& effect) const override {
    return of(row).expected * effect.shared_by_neighbours +
           of(row).sensitivity2 * effect.scan_angle_variance_rad2 +
           (part_of(row) == Part::range ? effect.scan_range_variance_mm2 : 0);
  }

 private:
  [[nodiscard]] Part part_of(Eigen::Index row) const { return parts_[static_cast<std::size_t>(row)]; }

  template <class Value>
  void add(Columns& base, double sigma, const Value& value) const {
    base.append(Eigen::VectorXd::NullaryExpr(rows(), value), Prior::around_zero(1, sigma));
  }

  /// By how much sectors scatter more than beams of independent noise.
  [[nodiscard]] double shared_in_sectors() const {
    double more = 0, all = 0;
    for (Eigen::Index i = 0; i < rows(); ++i) {
      if (part_of(i) != Part::sectors) continue;
      more += of(i).n * (of(i).y / of(i).expected - 1);
      all += of(i).n;
    }
    return all > 0 ? more / all : 0;
  }

  /// A wave that was taken off leaves something in all of them: it is as large as noise, and depends on no
  /// sensitivity.
  void add_rest_of_wave(Columns& base) const {
    for (const Part part : {Part::range, Part::angle, Part::sectors}) {
      double sum = 0, count = 0;
      for (Eigen::Index i = 0; i < rows(); ++i) {
        if (part_of(i) != part) continue;
        sum += of(i).expected;
        count += 1;
      }
      if (count > 0)
        add(base, sum / count, [=, this](Eigen::Index row) { return part_of(row) == part ? 1.0 : 0.0; });
    }
  }

  std::vector<Part> parts_;
};

struct Rows {
  std::vector<IndependentRows::Row> rows;
  std::vector<Part> parts;

  void add(const IndependentRows::Row& row, Part part) {
    rows.push_back(row);
    parts.push_back(part);
  }
};

/// Ranges and angles of whole scans, capture by capture.
void add_whole_scans(const Reduced& reduced, int fewest_scans, Rows& list) {
  struct Sums {
    IndependentRows::Row row;
    double number = 0;
  };
  std::map<std::pair<int, bool>, Sums> by_capture;
  for (const model::ScanPart& p : model::scan_parts(reduced, fewest_scans, 1)) {
    Sums& sums = by_capture[{p.capture, p.of_angle}];
    IndependentRows::Row& row = sums.row;
    row.at = p.at;
    row.at.seq = 0;  // of all scans
    row.capture = p.capture;
    row.y += p.rest_mm * p.rest_mm;
    row.n += p.news;
    row.sensitivity2 += p.sensitivity_mm * p.sensitivity_mm;
    row.expected += p.variance_mm2;
    sums.number += 1;
  }
  for (auto& [key, sums] : by_capture) {
    IndependentRows::Row& row = sums.row;
    if (row.n < 1) continue;
    row.y /= row.n;
    row.sensitivity2 /= sums.number;
    row.expected /= sums.number;
    list.add(row, key.second ? Part::angle : Part::range);
  }
}

/// Their sectors beside both.
void add_sectors(const Reduced& reduced, int fewest_scans, Rows& list) {
  for (const model::SectorScatter& sectors : model::sector_scatter(reduced, fewest_scans)) {
    IndependentRows::Row row;
    row.at = sectors.at;
    row.at.seq = 0;
    row.capture = sectors.capture;
    row.y = sectors.square_mm2;
    row.n = sectors.n;
    row.expected = sectors.expected_mm2;
    list.add(row, Part::sectors);
  }
}

}  // namespace

model::ChannelKind make_common() {
  model::ChannelKind kind;
  kind.id = "common";
  kind.observable = Observable::range_variance;
  kind.shows = "what a whole scan is off by, standard deviation";
  kind.unit = "mm";
  kind.is_square = true;
  kind.rows = [](const Reduced& reduced, const MeanNoise& noise) -> std::unique_ptr<model::ChannelRows> {
    Rows list;
    add_whole_scans(reduced, model::fewest_in_common, list);
    if (list.rows.empty()) return nullptr;
    add_sectors(reduced, model::fewest_in_common, list);
    // Autocorrelated scans say less of how they scatter.
    const double worth = model::worth_for_variance(noise.ar1_rho, noise.ar1_share);
    for (IndependentRows::Row& row : list.rows) row.n *= worth;
    return std::make_unique<CommonOfScans>(std::move(list.rows), std::move(list.parts),
                                           reduced.wave_hz.has_value());
  };
  return kind;
}

}  // namespace fit::explain::channels
