// SPDX-License-Identifier: MIT
#include "fit/range/selection.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

#include "fit/echo.hpp"
#include "fit/numeric/median.hpp"

namespace fit {
namespace {

constexpr double sd_of_mad = 1.4826;  // For a normal distribution.

bool is_echo(const Sample& sample) { return sample.range_mm > 0 && sample.range_mm < first_error_code_mm; }

struct Location {
  double median = 0, sigma = 0;
};

/// Whole millimetres, or a device's own coarser levels, make the median absolute deviation 0 for a quiet
/// lidar: there the mean deviation, of which no sample makes more than 10 mm, says more. Never below the
/// rounding's own.
Location robust_location(const std::vector<double>& values) {
  Location location{median_of(std::vector(values)), 0};
  std::vector<double> deviations;
  deviations.reserve(values.size());
  for (const double value : values) deviations.push_back(std::abs(value - location.median));
  double mean = 0;
  for (const double deviation : deviations)
    mean += std::min(deviation, 10.0) / static_cast<double>(deviations.size());
  const double mad = median_of(std::move(deviations));
  location.sigma = std::max({sd_of_mad * mad, mad < 1 ? 1.2533 * mean : 0, 1 / std::sqrt(12.0)});
  return location;
}

enum class Fate { kept, no_echo, abnormal, impulse };

double median_of_neighbours(const std::vector<double>& ranges, std::size_t i) {
  std::array<double, 5> window{};
  const std::size_t first = std::min(i >= 2 ? i - 2 : 0, ranges.size() - 5);
  std::copy_n(ranges.begin() + static_cast<std::ptrdiff_t>(first), 5, window.begin());
  std::nth_element(window.begin(), window.begin() + 2, window.end());
  return window[2];
}

std::vector<Fate> judge(std::span<const Sample> samples, const SelectionOptions& options, bool impulses) {
  std::vector<Fate> fates(samples.size(), Fate::kept);
  std::vector<double> ranges;
  for (const Sample& sample : samples)
    if (is_echo(sample)) ranges.push_back(sample.range_mm);
  if (ranges.empty()) return std::vector<Fate>(samples.size(), Fate::no_echo);
  const Location all = robust_location(ranges);
  const double gate = std::max(options.least_gate_mm, options.abnormal_sigmas * all.sigma);
  std::vector<std::size_t> index;
  ranges.clear();
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (!is_echo(samples[i]))
      fates[i] = Fate::no_echo;
    else if (std::abs(samples[i].range_mm - all.median) > gate)
      fates[i] = Fate::abnormal;
    else
      index.push_back(i), ranges.push_back(samples[i].range_mm);
  }
  const double spike = std::max(options.least_gate_mm, options.impulse_sigmas * all.sigma);
  for (std::size_t j = 0; impulses && ranges.size() >= 5 && j < ranges.size(); ++j)
    if (std::abs(ranges[j] - median_of_neighbours(ranges, j)) > spike) fates[index[j]] = Fate::impulse;
  return fates;
}

Rejections count(const std::vector<Fate>& fates) {
  Rejections rejected;
  for (const Fate fate : fates) {
    rejected.no_echo += fate == Fate::no_echo;
    rejected.abnormal += fate == Fate::abnormal;
    rejected.impulse += fate == Fate::impulse;
  }
  return rejected;
}

/// Uncertainty of a mean; below half a millimetre of noise, rounding to whole millimetres no longer averages
/// out.
double uncertainty_of_mean(double sd, double effective) {
  const double rounding = sd < 0.5 ? 1 / std::sqrt(12.0) : 0;
  return std::hypot(sd / std::sqrt(std::max(1.0, effective)), rounding);
}

void summarise(const std::vector<double>& kept, SelectedMean& out) {
  out.kept = static_cast<long>(kept.size());
  if (kept.empty()) {
    out.mean_mm = out.sd_mm = out.u_mm = std::numeric_limits<double>::quiet_NaN();
    return;
  }
  const double n = static_cast<double>(kept.size());
  out.mean_mm = std::accumulate(kept.begin(), kept.end(), 0.0) / n;
  double square = 0;
  for (const double value : kept) square += (value - out.mean_mm) * (value - out.mean_mm);
  out.sd_mm = kept.size() > 1 ? std::sqrt(square / (n - 1)) : 1 / std::sqrt(12.0);
  out.effective = n / correlation_time(kept);
  out.u_mm = uncertainty_of_mean(out.sd_mm, out.effective);
}

/// Of samples in the order in which they were taken.
void add_drift(const std::vector<double>& kept, SelectedMean& out) {
  if (kept.empty()) return;
  out.trend = trend_of(kept);
  if (out.trend.beyond(chance_of_drift)) {
    // The surface's range lies anywhere in the span that the mean passed through.
    out.u_drift_mm = std::abs(out.trend.rise.value) / std::sqrt(12.0);
    out.effective = out.trend.effective;
  }
  out.u_mm = std::hypot(uncertainty_of_mean(out.sd_mm, out.effective), out.u_drift_mm);
}

std::uint16_t most_frequent(std::span<const Sample> samples, const std::vector<Fate>& fates) {
  std::map<std::uint16_t, long> votes;
  for (std::size_t i = 0; i < samples.size(); ++i)
    if (fates[i] == Fate::kept) ++votes[samples[i].intensity];
  const auto best =
      std::ranges::max_element(votes, [](const auto& a, const auto& b) { return a.second < b.second; });
  return best == votes.end() ? std::uint16_t{0} : best->first;
}

}  // namespace

double correlation_time(std::span<const double> values) {
  const std::size_t n = values.size();
  if (n < 20) return 1;
  const double mean = std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(n);
  double variance = 0;
  for (const double value : values) variance += (value - mean) * (value - mean);
  if (variance <= 0) return 1;
  double time = 1;
  for (std::size_t lag = 1; lag < n / 4; ++lag) {
    double product = 0;
    for (std::size_t i = lag; i < n; ++i) product += (values[i] - mean) * (values[i - lag] - mean);
    const double rho = product / variance;
    if (rho < 3 / std::sqrt(static_cast<double>(n))) break;
    time += 2 * rho;
  }
  return std::min(time, static_cast<double>(n) / 2);
}

SelectedMean select_most_frequent(std::span<const Sample> samples, const SelectionOptions& options) {
  const std::vector<Fate> fates = judge(samples, options, true);
  SelectedMean out;
  out.samples = static_cast<long>(samples.size());
  out.rejected = count(fates);
  const std::uint16_t mode = most_frequent(samples, fates);
  out.intensity = mode;
  std::vector<double> kept;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (fates[i] != Fate::kept) continue;
    if (samples[i].intensity == mode)
      kept.push_back(samples[i].range_mm);
    else
      ++out.rejected.other_intensity;
  }
  summarise(kept, out);
  add_drift(kept, out);
  return out;
}

SelectedMean select_robust(std::span<const Sample> samples, const SelectionOptions& options) {
  const std::vector<Fate> fates = judge(samples, options, false);
  SelectedMean out;
  out.samples = static_cast<long>(samples.size());
  out.rejected = count(fates);
  std::vector<double> kept;
  double intensity = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (fates[i] != Fate::kept) continue;
    kept.push_back(samples[i].range_mm);
    intensity += samples[i].intensity;
  }
  summarise(kept, out);
  add_drift(kept, out);
  if (kept.empty()) return out;
  out.intensity = intensity / static_cast<double>(kept.size());
  constexpr double huber = 1.345;  // 95 % efficient for normal noise.
  const Location all = robust_location(kept);
  double location = all.median;
  for (int round = 0; round < 30; ++round) {
    double weight = 0, sum = 0;
    for (const double value : kept) {
      const double z = std::abs(value - location) / all.sigma, w = z <= huber ? 1 : huber / z;
      weight += w;
      sum += w * value;
    }
    const double next = sum / weight;
    if (std::abs(next - location) < 1e-9) break;
    location = next;
  }
  out.mean_mm = location;
  out.u_mm =
      std::hypot(uncertainty_of_mean(std::max(out.sd_mm, all.sigma), out.effective * 0.95), out.u_drift_mm);
  return out;
}

std::vector<IntensityClass> by_intensity(std::span<const Sample> samples, long least,
                                         const SelectionOptions& options) {
  const std::vector<Fate> fates = judge(samples, options, true);
  std::map<std::uint16_t, std::vector<double>> groups;
  for (std::size_t i = 0; i < samples.size(); ++i)
    if (fates[i] == Fate::kept) groups[samples[i].intensity].push_back(samples[i].range_mm);
  std::vector<IntensityClass> classes;
  std::vector<double> ranges;
  double intensities = 0;
  for (const auto& [intensity, values] : groups) {
    ranges.insert(ranges.end(), values.begin(), values.end());
    intensities += static_cast<double>(intensity) * static_cast<double>(values.size());
    if (static_cast<long>(ranges.size()) < least) continue;
    SelectedMean mean;
    summarise(ranges, mean);
    classes.push_back(
        {intensities / static_cast<double>(ranges.size()), mean.mean_mm, mean.sd_mm, mean.kept});
    ranges.clear();
    intensities = 0;
  }
  return classes;
}

}  // namespace fit
