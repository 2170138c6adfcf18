// SPDX-License-Identifier: MIT
#include "fit/explain/intensity/readings.hpp"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include "fit/median.hpp"

namespace fit::explain::intensity {
namespace {

using Eigen::Index;
using Eigen::VectorXd;
using L = IntensityLaw;

constexpr std::size_t rows_at_most = 4000, cells_at_least = 60;
constexpr double never_better = 0.002;

bool usable(const Cell& c) {
  return c.smooth && c.n > 0 && c.stray == 0 && std::isfinite(c.at.intensity) && c.at.intensity >= 4 &&
         c.lost * 20 <= c.n;
}

/// Scatter of a cell's intensity among its neighbours, relative, by how bright they are: device noise,
/// rounding, speckle, all that no law tells.
class Scatter {
 public:
  Scatter(const Reduced& reduced, const std::vector<std::size_t>& cells) {
    std::vector<std::pair<double, double>> bends;  // counts, squared bend over its variance factor
    for (std::size_t k = 1; k + 1 < cells.size(); ++k) {
      const Cell &a = reduced.cells[cells[k - 1]], &b = reduced.cells[cells[k]],
                 &c = reduced.cells[cells[k + 1]];
      if (a.group != c.group || a.at.target != b.at.target || c.at.target != b.at.target) continue;
      if (std::abs(c.beam_rad - a.beam_rad) > 3 * rad_per_deg) continue;
      const double bend = std::log(b.at.intensity) - 0.5 * std::log(a.at.intensity * c.at.intensity);
      bends.emplace_back(b.at.intensity, bend * bend / 1.5);
    }
    std::ranges::sort(bends);
    const std::size_t parts = std::clamp<std::size_t>(bends.size() / 100, 1, 8);
    for (std::size_t p = 0; p < parts; ++p) {
      const std::size_t from = p * bends.size() / parts, to = (p + 1) * bends.size() / parts;
      if (to <= from) continue;
      std::vector<double> squares;
      for (std::size_t i = from; i < to; ++i) squares.push_back(bends[i].second);
      table_.emplace_back(std::log(bends[(from + to) / 2].first),
                          std::sqrt(median_of(squares) / median_of_normal_squares));
    }
    if (table_.empty()) table_.emplace_back(0, 0.02);
  }

  [[nodiscard]] double at(double counts) const {
    const double x = std::log(counts), rounding = 0.29 / counts;
    std::size_t i = 0;
    while (i + 1 < table_.size() && table_[i + 1].first < x) ++i;
    double sigma = table_[i].second;
    if (i + 1 < table_.size() && x > table_[i].first) {
      const double f = (x - table_[i].first) / std::max(1e-9, table_[i + 1].first - table_[i].first);
      sigma += f * (table_[i + 1].second - sigma);
    }
    return std::max(sigma, 0.3 * rounding);
  }

 private:
  std::vector<std::pair<double, double>> table_;  ///< Logarithm of counts, scatter.
};

/// Neighbouring cells as one reading at their middle; its surface is left open.
Reading reading_of(const Reduced& reduced, std::span<const std::size_t> cells, const Scatter& scatter,
                   const L& law) {
  Reading reading;
  reading.cell = cells[(cells.size() - 1) / 2];
  const Cell& middle = reduced.cells[reading.cell];
  reading.reflectance = reflectance_of(reduced, middle);
  const auto said = [&](const Cell& c) {
    return law.log_counts(reading.reflectance, c.at.cos_incidence, c.at.range_mm);
  };
  double sum = 0, weight = 0;
  for (const std::size_t cell : cells) {
    const Cell& c = reduced.cells[cell];
    const double w = std::pow(scatter.at(c.at.intensity), -2);
    sum += w * (std::log(c.at.intensity) - said(c));
    weight += w;
  }
  reading.log_counts = said(middle) + sum / weight;
  reading.sigma = std::hypot(1 / std::sqrt(weight), never_better);
  return reading;
}

void take_rows(Readings& readings, const std::vector<std::size_t>& good, const Scatter& scatter) {
  const std::vector<Cell>& cells = readings.reduced.cells;
  // Neighbours are taken together in large sessions: nothing here is narrower than a few beams.
  const std::size_t together = (good.size() + rows_at_most - 1) / rows_at_most;
  std::vector<std::pair<int, double>> surfaces;
  for (std::size_t i = 0; i < good.size();) {
    std::size_t end = i + 1;
    const Cell& first = cells[good[i]];
    while (end < good.size() && end - i < together && cells[good[end]].group == first.group &&
           cells[good[end]].at.target == first.at.target)
      ++end;
    Reading row =
        reading_of(readings.reduced, std::span(good).subspan(i, end - i), scatter, readings.claim.law);
    const std::pair<int, double> surface(first.at.target, row.reflectance);
    const auto found = std::ranges::find(surfaces, surface);
    row.surface = static_cast<int>(found - surfaces.begin());
    if (found == surfaces.end()) surfaces.push_back(surface);
    readings.rows.push_back(row);
    i = end;
  }
  readings.surfaces = static_cast<int>(surfaces.size());
}

/// What is not stated starts from where the recording is.
void take_gain(Readings& readings) {
  if (readings.claim.stated[L::gain]) return;
  double sum = 0;
  for (Index i = 0; i < readings.count(); ++i)
    sum += readings.row(i).log_counts - readings.predicted(i, readings.claim.law);
  readings.claim.law.value[L::gain] += sum / static_cast<double>(readings.rows.size());
}

/// What is predicted from the rest to judge an explanation: whole captures, or sectors of beams of few.
void take_parts(Readings& readings) {
  std::vector<int> captures;
  for (Index i = 0; i < readings.count(); ++i) captures.push_back(readings.group(i).capture);
  std::vector<int> distinct = captures;
  std::ranges::sort(distinct);
  distinct.erase(std::unique(distinct.begin(), distinct.end()), distinct.end());
  const bool by_capture = distinct.size() >= 6;
  for (Index i = 0; i < readings.count(); ++i) {
    const int sector = static_cast<int>(std::floor(readings.cell(i).beam_rad * deg_per_rad / 4 + 1000));
    const auto number =
        std::ranges::lower_bound(distinct, captures[static_cast<std::size_t>(i)]) - distinct.begin();
    readings.part.push_back(by_capture ? static_cast<int>(number % held_out_parts) : sector % held_out_parts);
  }
}

double typical_scatter(const Readings& readings, const Scatter& scatter) {
  std::vector<double> list;
  for (Index i = 0; i < readings.count(); ++i) list.push_back(scatter.at(readings.cell(i).at.intensity));
  return median_of(list);
}

}  // namespace

VectorXd Readings::coordinate(Coordinate c) const {
  VectorXd x(count());
  // Brightness as predicted: what was measured would be its own cause.
  for (Index i = 0; i < count(); ++i)
    x[i] = c == Coordinate::intensity ? std::exp(predicted(i, claim.law)) : value_of(c, cell(i), group(i));
  return x;
}

std::optional<Readings> readings_of(const Reduced& reduced, const IntensityClaim& claim) {
  std::vector<std::size_t> good;
  for (std::size_t i = 0; i < reduced.cells.size(); ++i)
    if (usable(reduced.cells[i])) good.push_back(i);
  if (good.size() < cells_at_least) return std::nullopt;
  const Scatter scatter(reduced, good);
  Readings readings{.reduced = reduced, .claim = claim};
  take_rows(readings, good, scatter);
  take_gain(readings);
  take_parts(readings);
  readings.scatter = typical_scatter(readings, scatter);
  return readings;
}

std::optional<double> sample_noise(const Readings& readings) {
  std::vector<double> list;
  for (Index i = 0; i < readings.count(); ++i)
    if (const Cell& cell = readings.cell(i); cell.n > 2)
      list.push_back(cell.intensity_sd / cell.at.intensity);
  if (list.size() < 20) return readings.claim.relative_noise;
  return median_of(list);
}

std::vector<int> stated_coefficients(const IntensityClaim& claim) {
  std::vector<int> list;
  for (int k = 0; k < L::size; ++k)
    if (claim.stated[static_cast<std::size_t>(k)]) list.push_back(k);
  return list;
}

}  // namespace fit::explain::intensity
