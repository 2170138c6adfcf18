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

/// A row, what independent noise of the samples makes of it, mm^2, and what it is about.
struct Scatter {
  IndependentRows::Row row;
  double of_samples_mm2 = 0;
  Part part = Part::range;
};

/// By how much scans of a capture scatter beside what repeats, as a whole and from sector to sector: a gamma
/// distribution around the variance that their samples' noise leaves them. Ranges and angles that every scan
/// draws anew add to the whole; noise that neighbouring beams share multiplies both.
class CommonOfScans final : public model::GammaRows {
 public:
  CommonOfScans(std::vector<Row> rows, std::vector<Scatter> scatter, bool had_a_wave)
      : GammaRows(std::move(rows), 1e-6), scatter_(std::move(scatter)) {
    constexpr double independent = 0.05;  // to which beams side by side are
    model::Columns base;
    add(base, independent, [](const Scatter& s) { return s.of_samples_mm2; });
    // What neighbours share may reach beyond a sector, and where it is more it weighs otherwise in each.
    constexpr double otherwise = 0.5;
    if (const double shared = shared_in_sectors(); shared > independent)
      for (const Part part : {Part::range, Part::angle})
        add(base, otherwise * shared,
            [part](const Scatter& s) { return s.part == part ? s.of_samples_mm2 : 0; });
    if (had_a_wave) add_rest_of_wave(base);
    set_base(std::move(base));
  }
  [[nodiscard]] bool sees(Coordinate) const override { return true; }
  [[nodiscard]] double response(Eigen::Index row, const Effect& effect) const override {
    const Scatter& s = scatter_[static_cast<std::size_t>(row)];
    return s.of_samples_mm2 * effect.shared_by_neighbours + of(row).lever2 * effect.scan_angle_variance_rad2 +
           (s.part == Part::range ? effect.scan_range_variance_mm2 : 0);
  }
  [[nodiscard]] double offset(Eigen::Index row) const override {
    return scatter_[static_cast<std::size_t>(row)].of_samples_mm2;
  }

 private:
  template <class Value>
  void add(model::Columns& base, double sigma, const Value& value) const {
    const Eigen::Index k = base.columns.cols();
    base.columns.conservativeResize(rows(), k + 1);
    for (Eigen::Index i = 0; i < rows(); ++i)
      base.columns(i, k) = value(scatter_[static_cast<std::size_t>(i)]);
    base.prior.mean.conservativeResize(k + 1);
    base.prior.sigma.conservativeResize(k + 1);
    base.prior.mean[k] = 0;
    base.prior.sigma[k] = sigma;
  }

  /// By how much sectors scatter more than beams of independent noise.
  [[nodiscard]] double shared_in_sectors() const {
    double more = 0, all = 0;
    for (Eigen::Index i = 0; i < rows(); ++i) {
      const Scatter& s = scatter_[static_cast<std::size_t>(i)];
      if (s.part != Part::sectors || !(s.of_samples_mm2 > 0)) continue;
      more += of(i).n * (of(i).y / s.of_samples_mm2 - 1);
      all += of(i).n;
    }
    return all > 0 ? more / all : 0;
  }

  /// A wave that was taken off leaves something in all of them: it is as large as noise, and depends on no
  /// lever.
  void add_rest_of_wave(model::Columns& base) const {
    for (const Part part : {Part::range, Part::angle, Part::sectors}) {
      double sum = 0, count = 0;
      for (const Scatter& s : scatter_) {
        if (s.part != part) continue;
        sum += s.of_samples_mm2;
        count += 1;
      }
      if (count > 0) add(base, sum / count, [part](const Scatter& s) { return s.part == part ? 1.0 : 0.0; });
    }
  }

  std::vector<Scatter> scatter_;
};

/// Ranges and angles of whole scans, capture by capture.
std::vector<Scatter> of_whole_scans(const Reduced& reduced, int fewest_scans) {
  struct Sums {
    Scatter scatter;
    double number = 0;
  };
  std::map<std::pair<int, bool>, Sums> by_capture;
  for (const model::ScanPart& p : model::scan_parts(reduced, fewest_scans, 1)) {
    Sums& sums = by_capture[{p.capture, p.of_angle}];
    Scatter& s = sums.scatter;
    s.part = p.of_angle ? Part::angle : Part::range;
    s.row.at = p.at;
    s.row.capture = p.capture;
    s.row.y += p.rest_mm * p.rest_mm;
    s.row.n += p.news;
    s.row.lever2 += p.lever_mm * p.lever_mm;
    s.of_samples_mm2 += p.variance_mm2;
    sums.number += 1;
  }
  std::vector<Scatter> list;
  for (auto& [key, sums] : by_capture) {
    Scatter& s = sums.scatter;
    if (s.row.n < 1) continue;
    s.row.y /= s.row.n;
    s.row.lever2 /= sums.number;
    s.of_samples_mm2 /= sums.number;
    list.push_back(s);
  }
  return list;
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
    constexpr int fewest_scans = 3;
    std::vector<Scatter> scatter = of_whole_scans(reduced, fewest_scans);
    if (scatter.empty()) return nullptr;
    for (const model::SectorScatter& sectors : model::sector_scatter(reduced, fewest_scans)) {
      Scatter& s = scatter.emplace_back();
      s.part = Part::sectors;
      s.row.at = sectors.at;
      s.row.capture = sectors.capture;
      s.row.y = sectors.square_mm2;
      s.row.n = sectors.n;
      s.of_samples_mm2 = sectors.expected_mm2;
    }
    // Scans that remember the noise of those before say less of how they scatter.
    const double worth = model::worth_for_variance(noise.memory_rho, noise.memory_share);
    std::vector<IndependentRows::Row> rows;
    for (const Scatter& s : scatter) {
      rows.push_back(s.row);
      rows.back().n *= worth;
    }
    return std::make_unique<CommonOfScans>(std::move(rows), std::move(scatter), reduced.wave_hz.has_value());
  };
  return kind;
}

}  // namespace fit::explain::channels
