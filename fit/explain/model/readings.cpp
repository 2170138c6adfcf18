// SPDX-License-Identifier: MIT
#include "fit/explain/model/readings.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "fit/numeric/median.hpp"

namespace fit::explain::model {
namespace {

/// Whole counts of less are too coarse for a logarithm.
constexpr double fewest_counts = 4;

bool is_bright(const Cell& c) {
  return c.usable && c.n > 0 && c.stray == 0 && std::isfinite(c.counts) && c.counts >= fewest_counts &&
         c.lost * 20 <= c.n;
}

bool are_neighbours(const Cell& a, const Cell& b) { return a.group == b.group && a.at.target == b.at.target; }

/// Scatter of a cell's counts among its neighbours, relative, by how bright they are: device noise, rounding,
/// speckle, all that no law tells.
class Scatter {
 public:
  Scatter(const Reduced& reduced, const std::vector<std::size_t>& cells) {
    constexpr double same_place_rad = 3 * rad_per_deg;
    std::vector<std::pair<double, double>> bends;  // counts, squared bend over its variance factor
    for (std::size_t k = 1; k + 1 < cells.size(); ++k) {
      const Cell &a = reduced.cells[cells[k - 1]], &b = reduced.cells[cells[k]],
                 &c = reduced.cells[cells[k + 1]];
      if (!are_neighbours(a, b) || !are_neighbours(b, c) ||
          std::abs(c.beam_rad - a.beam_rad) > same_place_rad)
        continue;
      const double bend = std::log(b.counts) - 0.5 * std::log(a.counts * c.counts);
      bends.emplace_back(b.counts, bend * bend / 1.5);
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
Reading reading_of(const Reduced& reduced, const std::vector<const Cell*>& cells, const Scatter& scatter,
                   const IntensityLaw& law) {
  const Cell& middle = *cells[(cells.size() - 1) / 2];
  Reading reading;
  reading.at = middle.at;
  reading.at.reflectance = middle.at.reflectance;
  reading.capture = reduced.group_of(middle).capture;
  const auto by_law = [&](const Cell& c) {
    return law.log_counts(reading.at.reflectance, c.at.cos_incidence, c.at.range_mm);
  };
  double sum = 0, weight = 0;
  for (const Cell* c : cells) {
    const double w = std::pow(scatter.at(c->counts), -2);
    sum += w * (std::log(c->counts) - by_law(*c));
    weight += w;
  }
  reading.at.intensity = std::exp(by_law(middle));
  reading.per_echo = law.receiver_slope(reading.at.intensity);
  reading.off = sum / weight;
  reading.sigma = 1 / std::sqrt(weight);
  return reading;
}

/// By how much more than it should the mean of so many neighbours lies off the line through those beside it:
/// what neighbours share.
double excess_of(const std::vector<Reading>& readings, std::size_t together) {
  struct Mean {
    int capture, surface;
    double off, variance;
  };
  std::vector<Mean> means;
  for (std::size_t i = 0; i + together <= readings.size();) {
    double sum = 0, weight = 0;
    std::size_t k = i;
    for (; k < i + together && readings[k].capture == readings[i].capture &&
           readings[k].surface == readings[i].surface;
         ++k) {
      const double w = std::pow(readings[k].sigma, -2);
      sum += w * readings[k].off;
      weight += w;
    }
    if (k == i + together)
      means.push_back({readings[i].capture, readings[i].surface, sum / weight, 1 / weight});
    i = k;
  }
  std::vector<double> squares;
  for (std::size_t i = 1; i + 1 < means.size(); ++i) {
    const Mean &a = means[i - 1], &b = means[i], &c = means[i + 1];
    if (a.capture != c.capture || a.surface != c.surface || b.surface != c.surface) continue;
    squares.push_back(std::pow(b.off - (a.off + c.off) / 2, 2) /
                      (b.variance + (a.variance + c.variance) / 4));
  }
  constexpr std::size_t enough = 8;
  return squares.size() < enough ? 1 : std::max(1.0, median_of(squares) / median_of_normal_squares);
}

}  // namespace

std::vector<Reading> readings_of(const Reduced& reduced, const IntensityLaw& law, std::size_t most) {
  constexpr std::size_t fewest_cells = 60;
  std::vector<std::size_t> good;
  for (std::size_t i = 0; i < reduced.cells.size(); ++i)
    if (is_bright(reduced.cells[i])) good.push_back(i);
  std::vector<Reading> readings;
  if (good.size() < fewest_cells) return readings;
  const Scatter scatter(reduced, good);
  std::vector<std::pair<int, double>> surfaces;
  for (std::vector<const Cell*>& run : taken_together(reduced, most)) {
    std::erase_if(run, [](const Cell* cell) { return !is_bright(*cell); });
    if (run.empty()) continue;
    Reading reading = reading_of(reduced, run, scatter, law);
    const std::pair<int, double> surface(reading.at.target, reading.at.reflectance);
    const auto found = std::ranges::find(surfaces, surface);
    reading.surface = static_cast<int>(found - surfaces.begin());
    if (found == surfaces.end()) surfaces.push_back(surface);
    readings.push_back(reading);
  }
  constexpr std::size_t dozen = 12;
  const std::size_t together = good.size() / std::max<std::size_t>(1, readings.size());
  const double excess =
      std::sqrt(excess_of(readings, std::max<std::size_t>(1, dozen / std::max<std::size_t>(1, together))));
  for (Reading& reading : readings) reading.sigma *= excess;
  return readings;
}

double sample_noise(const Reduced& reduced) {
  constexpr std::size_t enough = 20;
  std::vector<double> list;
  for (const Cell& c : reduced.cells)
    if (is_bright(c) && c.n > 2) list.push_back(c.intensity_sd / c.counts);
  return list.size() < enough ? 0 : median_of(list);
}

}  // namespace fit::explain::model
