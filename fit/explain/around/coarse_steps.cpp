// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <complex>
#include <optional>
#include <unsupported/Eigen/FFT>
#include <vector>

#include "fit/explain/around/around.hpp"
#include "fit/numeric/straight_line.hpp"

namespace fit::explain {
namespace {

constexpr const char* rounding = "rounding";

/// A comb of ranges, which are rounded to whole millimetres after it.
struct Steps {
  double step_mm = 1, u_mm = 0, first_mm = 0;
  double gain = 0;  ///< Of the log-likelihood, over any whole number.

  /// The nearest step's number.
  [[nodiscard]] double number_at(double mm) const { return std::round((mm - first_mm) / step_mm); }
  [[nodiscard]] double off_mm(double mm, double number) const { return mm - first_mm - number * step_mm; }
};

/// How the samples of cells scatter, of not too many.
std::vector<OutputSteps::Scatter> scatter_of(const Reduced& reduced) {
  constexpr std::size_t enough = 3000;
  std::vector<OutputSteps::Scatter> list;
  for (std::size_t i = 0; i < reduced.cells.size(); i += reduced.cells.size() / enough + 1)
    if (const Cell& cell = reduced.cells[i]; cell.usable && cell.n > 1)
      list.push_back({cell.mean_mm, cell.variance_mm2, cell.n - 1.0});
  return list;
}

/// How strongly ranges repeat along the range: share of the samples in step, by waves per `window` mm.
constexpr std::size_t window = 1 << 17;
std::vector<double> coherence(const std::vector<long>& shown, double all) {
  std::vector<double> counts(window, 0.0);
  std::ranges::copy(shown, counts.begin());
  std::vector<std::complex<double>> waves;
  Eigen::FFT<double> fft;
  fft.fwd(waves, counts);
  std::vector<double> shares(window / 2 + 2);  // as far as the finest, and its neighbour
  for (std::size_t k = 0; k < shares.size(); ++k) shares[k] = std::abs(waves[k]) / all;
  return shares;
}

/// The comb of about that step on which most ranges lie; none if more lie beside it than come from elsewhere.
std::optional<Steps> comb_near(const std::vector<long>& shown, double step_mm, double all, double strays) {
  constexpr double nearly_all = 0.97, few = 0.007;  // of samples that are no strays, beside the steps
  Steps steps{.step_mm = step_mm};
  double on = 0;
  for (int pass = 0; pass < 3; ++pass) {
    std::complex<double> wave = 0;
    for (std::size_t mm = 0; mm < shown.size(); ++mm)
      if (shown[mm] > 0)
        wave += std::polar(static_cast<double>(shown[mm]), 2 * pi * static_cast<double>(mm) / steps.step_mm);
    steps.first_mm = std::arg(wave) / (2 * pi) * steps.step_mm;
    // A line through the ranges over the numbers of their steps.
    StraightLine line;
    on = 0;
    for (std::size_t mm = 0; mm < shown.size(); ++mm) {
      if (shown[mm] == 0) continue;
      const auto count = static_cast<double>(shown[mm]);
      const auto at_mm = static_cast<double>(mm);
      const double k = steps.number_at(at_mm), off = steps.off_mm(at_mm, k);
      constexpr double rounded_by_mm = 0.5 + 0.05, of_first_guess_mm = 0.25;
      if (std::abs(off) < rounded_by_mm) on += count;
      if (std::abs(off) < rounded_by_mm + of_first_guess_mm) line.add(k, off);  // strays lie anywhere
    }
    if (line.spread() <= 0) return {};
    steps.step_mm += line.slope();
    steps.u_mm = std::sqrt(rounding_mm2 / line.spread());
  }
  if (on < nearly_all * (1 - strays) * all) return {};
  const double anywhere = strays + few;
  steps.gain = on * std::log((1 - anywhere) * steps.step_mm + anywhere) + (all - on) * std::log(anywhere);
  return steps;
}

/// The comb between those whose places, rounded to whole millimetres, are the most of the ranges: a place
/// half a millimetre off a whole one is read off as one or the other. What is as rare as strays says nothing.
void settle(Steps& steps, const std::vector<long>& shown, double strays) {
  struct OnComb {
    double k, off_mm, count;
  };
  constexpr double widest_mm = 0.3, fine_mm = 0.02, rounded_by_mm = 0.5;
  std::vector<OnComb> list;
  std::size_t end = shown.size();
  while (end > 1 && shown[end - 1] == 0) --end;
  const double by_chance = strays / static_cast<double>(end), rare = by_chance + 4 * std::sqrt(by_chance);
  for (std::size_t i = 0; i < end; ++i) {
    const auto mm = static_cast<double>(i);
    const double k = steps.number_at(mm), off = steps.off_mm(mm, k);
    if (static_cast<double>(shown[i]) > rare && std::abs(off) < rounded_by_mm + widest_mm)
      list.push_back({k, off, static_cast<double>(shown[i])});
  }
  if (list.empty() || list.front().k == list.back().k) return;
  const double low = list.front().k, across = list.back().k - low;
  double most = 0, ways = 0, shift_mm = 0, stretch_mm = 0, stretches_mm2 = 0;
  for (double at_low = -widest_mm; at_low <= widest_mm; at_low += fine_mm)
    for (double at_high = -widest_mm; at_high <= widest_mm; at_high += fine_mm) {
      const double stretch = at_high - at_low;
      double on = 0;
      for (const OnComb& one : list)
        if (std::abs(one.off_mm - at_low - stretch * (one.k - low) / across) <= rounded_by_mm)
          on += one.count;
      if (on < most) continue;
      if (on > most) most = on, ways = shift_mm = stretch_mm = stretches_mm2 = 0;
      ++ways;
      shift_mm += at_low;
      stretch_mm += stretch;
      stretches_mm2 += stretch * stretch;
    }
  shift_mm /= ways;
  stretch_mm /= ways;
  steps.step_mm += stretch_mm / across;
  steps.first_mm += shift_mm - stretch_mm * low / across;
  const double spread_mm2 = std::max(0.0, stretches_mm2 / ways - stretch_mm * stretch_mm);
  steps.u_mm = std::sqrt(spread_mm2 + fine_mm * fine_mm / 6) / across;
}

/// Share of samples that are too far from their targets: where they come from, no comb may be.
double share_of_strays(const std::vector<Cell>& cells) {
  double near = 0, stray = 0;
  for (const Cell& cell : cells) {
    near += cell.n;
    stray += cell.stray;
  }
  return near > 0 ? stray / (near + stray) : 0;
}

/// The coarsest step of which nearly all ranges are a multiple.
std::optional<Steps> coarsest(const std::vector<long>& shown, double strays) {
  constexpr double fewest = 200, coarsest_mm = 50, finest_mm = 2, in_step = 0.5;
  double all = 0;
  for (const long count : shown) all += static_cast<double>(count);
  if (all < fewest) return {};
  const std::vector<double> shares = coherence(shown, all);
  const auto first = static_cast<std::size_t>(window / coarsest_mm);
  for (std::size_t k = first; k + 1 < shares.size() && k <= window / finest_mm; ++k) {
    if (shares[k] < in_step || shares[k] < shares[k - 1] || shares[k] < shares[k + 1]) continue;
    std::optional<Steps> steps =
        comb_near(shown, static_cast<double>(window) / static_cast<double>(k), all, strays);
    if (!steps) continue;
    settle(*steps, shown, strays * all);
    return steps;
  }
  return {};
}

}  // namespace

std::optional<Suspect> find_coarse_steps(Reduced& reduced) {
  constexpr double improbable = 15;  // gain: a mechanism, its step, and single samples that decide
  const std::optional<Steps> found = coarsest(reduced.shown, share_of_strays(reduced.cells));
  if (!found || found->gain < improbable) return {};
  const double sigma_mm = reduced.typical_sigma_mm();
  // A parked target without noise repeats itself too: then its spread is far below the step.
  if (sigma_mm < 0.25 * found->step_mm && reduced.cells.size() < 50) return {};
  Suspect suspect;
  suspect.mechanism = find_mechanism(rounding);
  suspect.gain = found->gain;
  suspect.parameters = {{"step_mm", {found->step_mm, found->u_mm}}};
  OutputSteps& steps = reduced.output_steps;
  steps = {found->step_mm, found->first_mm, sigma_mm};
  if (const auto scatter = scatter_of(reduced); !scatter.empty()) steps.sigma_mm = steps.noise_of(scatter);
  return suspect;
}

}  // namespace fit::explain
