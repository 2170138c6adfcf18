// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "fit/explain/reduction/edge_shares.hpp"
#include "fit/explain/reduction/placing.hpp"
#include "fit/explain/scene/stated_noise.hpp"
#include "fit/numeric/median.hpp"

namespace fit::explain::reduction {
namespace {

/// What came back to a cell.
struct Returned {
  std::vector<double> ranges_mm;  ///< Brought to the cell's middle.
  int looked = 0, lost = 0;
  int lit = 0;  ///< With an intensity.
  double intensity = 0, intensity_squares = 0;
  double aside_squares_rad2 = 0;
};

Returned returned_to(const Cell& cell, const Setting& setting, const Beams& beams) {
  const Samples& samples = setting.samples;
  Returned all;
  all.ranges_mm.reserve(static_cast<std::size_t>(samples.scans) * static_cast<std::size_t>(beams.count));
  // Beams taken together are brought to their middle.
  const auto aside_mm = [&](int beam) {
    if (beams.count == 1) return 0.0;
    const double beam_rad = samples.beam_rad[static_cast<std::size_t>(beam)];
    const Sight sight = setting.scene.look(setting.group.stage_rad, beam_rad);
    return sight.target < 0 ? 0 : sight.range_mm - cell.nominal_mm;
  };
  for (int scan = 0; scan < samples.scans; ++scan) {
    for (int beam = beams.first; beam < beams.first + beams.count; ++beam) {
      const double range = samples.at(scan, beam);
      if (range == not_looked) continue;
      ++all.looked;
      if (!is_echo(range)) {
        ++all.lost;
        continue;
      }
      all.ranges_mm.push_back(range - aside_mm(beam));
      if (samples.grid) all.aside_squares_rad2 += std::pow(samples.aside_rad[samples.index(scan, beam)], 2);
      if (samples.intensity.empty()) continue;
      const double counts = samples.intensity[samples.index(scan, beam)];
      all.intensity += counts;
      all.intensity_squares += counts * counts;
      ++all.lit;
    }
  }
  return all;
}

void summarise_intensity(const Returned& all, Cell& cell) {
  cell.at.intensity = cell.counts = all.intensity / all.lit;
  if (all.lit < 2) return;
  const double squares = all.intensity_squares - all.intensity * all.intensity / all.lit;
  cell.intensity_sd = std::sqrt(std::max(0.0, squares / (all.lit - 1)));
}

/// Near an edge: where between the two surfaces the samples lie, of which some are kept.
void note_place_at_edge(const std::vector<double>& ranges_mm, double sigma_mm, Cell& cell, Reduced& session) {
  constexpr std::size_t kept_at_most = 200;
  if (!(cell.other_mm > 0)) return;
  cell.first_beside = session.beside.size();
  const std::size_t every = (ranges_mm.size() + kept_at_most - 1) / kept_at_most;
  for (std::size_t i = 0; i < ranges_mm.size(); i += every)
    session.beside.push_back(static_cast<float>(ranges_mm[i]));
  cell.beside = static_cast<int>(session.beside.size() - cell.first_beside);
  const bool on_near = cell.at.edge_rad > 0;
  share_out(ranges_mm, on_near ? cell.nominal_mm : cell.other_mm, on_near ? cell.other_mm : cell.nominal_mm,
            sigma_mm, cell);
}

/// Ranges around their own median: a cut around a prediction, which is off by as much as the mount is
/// unknown, lets noise decide on one side only, and shifts the means.
struct Core {
  double middle_mm = 0;
  double spread_mm = 0;  ///< Standard deviation, robust.
};

Core core_of(std::vector<double> ranges_mm) {
  const double middle = median_of(ranges_mm);
  for (double& v : ranges_mm) v = std::abs(v - middle);
  return {middle, 1.4826 * median_of(ranges_mm)};
}

/// How far (mm) from the median a sample may lie that belongs to the target.
double reach_of(const Core& core, std::size_t samples, double sigma_mm, bool turning) {
  if (turning) return std::max(60.0, 10 * sigma_mm);
  // A few samples say little about their own spread.
  const double least = samples < 50 ? 25 : 4;
  return std::max({least, 6 * sigma_mm, 5 * core.spread_mm});
}

/// Sums of the powers of deviations from somewhere near the mean.
struct Powers {
  double first = 0, second = 0, third = 0, fourth = 0;

  void add(double off) {
    const double square = off * off;
    first += off;
    second += square;
    third += square * off;
    fourth += square * square;
  }
  [[nodiscard]] double variance(int n) const { return std::max(0.0, (second - first * first / n) / (n - 1)); }
  /// 0 if the distribution is symmetric; of few samples as much as of many (Joanes and Gill 1998, G1).
  [[nodiscard]] double skewness(int n) const {
    const double mean = first / n, square = second / n - mean * mean;
    if (n < 3 || square <= 1e-6) return 0;
    const double third_moment = third / n - 3 * mean * second / n + 2 * std::pow(mean, 3);
    return third_moment / std::pow(square, 1.5) * std::sqrt(n * (n - 1.0)) / (n - 2);
  }
  /// 3 if the distribution is normal, however few the samples (Joanes and Gill 1998: of n normal samples it
  /// comes out as 3 (n - 1) / (n + 1)).
  [[nodiscard]] double kurtosis(int n) const {
    const double mean = first / n, square = second / n - mean * mean;
    if (n < 4 || square <= 1e-6) return 3;
    const double fourth_moment =
        fourth / n - 4 * mean * third / n + 6 * mean * mean * second / n - 3 * std::pow(mean, 4);
    return fourth_moment / (square * square) * (n + 1) / (n - 1);
  }
};

/// Mean and variance of those within reach; all others are strays.
void average(const std::vector<double>& ranges_mm, double middle_mm, double reach_mm, double sigma_mm,
             bool keep_samples, Cell& cell, Reduced& session) {
  const Reach of_noise(sigma_mm);
  const double too_far_mm = std::max(reach_mm, of_noise.too_far_mm);
  Powers powers;
  cell.first_kept = session.kept.size();
  for (const double range : ranges_mm) {
    const double off = range - middle_mm;
    if (std::abs(off) <= reach_mm) {
      powers.add(off);
      ++cell.n;
      if (keep_samples) session.kept.push_back(static_cast<float>(range));
      continue;
    }
    ++cell.stray;
    if (std::abs(off) <= too_far_mm) continue;
    ++cell.far;
    if (std::abs(off) < of_noise.close_mm) ++(off > 0 ? cell.late : cell.early);
    if (!cell.usable || session.strays_mm.size() >= session.most_strays) continue;
    session.strays_mm.push_back(static_cast<float>(range));
    session.strays_of_target.push_back(static_cast<float>(range / middle_mm));
  }
  if (cell.n > 0) cell.mean_mm = middle_mm + powers.first / cell.n;
  if (cell.n > 1) cell.variance_mm2 = powers.variance(cell.n);
  cell.kurtosis = powers.kurtosis(cell.n);
  cell.skewness = powers.skewness(cell.n);
}

/// Whether samples so spread and so many may be compared with a surface.
void judge_samples(const Core& core, int echoes, double sigma_mm, bool turning, Cell& cell) {
  if (turning && cell.stray > 0) cell.usable = false;  // which of three is wrong nobody knows
  // A robust spread of few samples scatters by 1.17 / sqrt(n) of itself; what chance does is left in, or what
  // is left would be less noisy than the others.
  const double wider = std::max(1.6, 1 + 4 * 1.17 / std::sqrt(std::max(1, echoes)));
  const bool mixed =
      core.spread_mm > wider * sigma_mm + 1 || cell.stray > 0 || cell.lost > 0 || cell.between > 0;
  if (cell.usable && cell.doubtful) {  // beside an edge: all samples, or none, met that surface
    cell.usable = !mixed && std::abs(cell.off_mm()) < 60 + 5 * sigma_mm;
    cell.doubtful = !cell.usable;
  }
  if (mixed) cell.doubtful = false;
  if (core.spread_mm > 4 * sigma_mm + 20) cell.usable = false;
  if (cell.n * 2 < echoes) cell.usable = false;
}

}  // namespace

double typical_spread(const Samples& samples, const Bench& bench) {
  std::vector<double> spreads;
  for (int beam = 0; beam < samples.beams; beam += std::max(1, samples.beams / 200)) {
    double sum = 0;
    int count = 0;
    for (int scan = 1; scan < samples.scans; ++scan) {
      const double a = samples.at(scan, beam), b = samples.at(scan - 1, beam);
      if (!is_echo(a) || !is_echo(b) || std::abs(a - b) > 400) continue;
      sum += std::abs(a - b);
      ++count;
    }
    if (count > 0) spreads.push_back(sum / count * 0.8862);
  }
  if (!spreads.empty()) return std::max(0.3, median_of(spreads));
  const double stated = stated_noise(bench).value;
  return stated > 0 ? stated : unstated_noise_mm;
}

void summarise(const Setting& setting, const Beams& beams, bool keep_samples, Cell& cell, Reduced& session) {
  const double sigma_mm = setting.group.sigma_mm;
  const bool turning = is_turning(setting.capture);
  const Returned all = returned_to(cell, setting, beams);
  cell.lost = all.lost;
  session.samples += static_cast<long>(all.ranges_mm.size());
  if (all.lit > 0) {
    summarise_intensity(all, cell);
    session.has_intensity = true;
  }
  if (all.ranges_mm.empty()) {
    cell.usable = cell.doubtful = false;
    return;
  }
  cell.aside_rad2 = all.aside_squares_rad2 / static_cast<double>(all.ranges_mm.size());
  const bool in_clear = cell.usable && !cell.doubtful;
  note_place_at_edge(all.ranges_mm, sigma_mm, cell, session);
  const Core core = core_of(all.ranges_mm);
  const double reach_mm = reach_of(core, all.ranges_mm.size(), sigma_mm, turning);
  average(all.ranges_mm, core.middle_mm, reach_mm, sigma_mm, keep_samples, cell, session);
  if (cell.n == 0) {
    cell.usable = false;
    return;
  }
  judge_samples(core, all.looked - all.lost, sigma_mm, turning, cell);
  const bool is_off = std::abs(cell.off_mm()) > off_target_mm;
  if (is_off) cell.usable = false;
  session.in_clear += in_clear;
  session.off_targets += in_clear && is_off;
}

}  // namespace fit::explain::reduction
