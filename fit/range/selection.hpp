// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "fit/range/trend.hpp"

namespace fit {

/// One echo of one beam as the lidar reports it. Range 0: no echo.
struct Sample {
  std::uint16_t range_mm = 0, intensity = 0;
};

/// Why samples were left out, each counted once, under the first reason that applies in this order.
struct Rejections {
  long no_echo = 0;          ///< Range 0 or an error code.
  long abnormal = 0;         ///< So far from the median that it is another surface or nonsense.
  long impulse = 0;          ///< A single sample that stands out from its neighbours in time.
  long other_intensity = 0;  ///< Not of the most frequent intensity.
  [[nodiscard]] long total() const { return no_echo + abnormal + impulse + other_intensity; }
};

/// The mean range of the samples that were kept.
struct SelectedMean {
  double mean_mm = 0;
  double sd_mm = 0;      ///< Of one sample.
  double u_mm = 0;  ///< Standard uncertainty of the mean, with the samples' correlation in time and drift.
  double u_drift_mm =
      0;        ///< Its part that is their drift: 0 where steady samples show such a trend by chance.
  Trend trend;  ///< Of the kept samples over the capture, mm.
  double intensity = 0;  ///< The most frequent one, or the mean for select_robust().
  long samples = 0, kept = 0;
  double effective = 0;  ///< Independent samples that the kept ones are worth.
  Rejections rejected;
};

struct SelectionOptions {
  double abnormal_sigmas = 8;   ///< From the median, in robust standard deviations.
  double impulse_sigmas = 4.5;  ///< From the median of its five neighbours.
  double least_gate_mm = 3;     ///< Neither gate is narrower: ranges come in whole millimetres.
};

/// Source A, experiment A2: abnormal values and impulse noise are removed; of the rest, only the samples of
/// the most frequent intensity are averaged. Samples are in the order in which they were taken. Without
/// intensities (all 0) every sample has the same one. With nothing left, `kept` is 0 and the mean NaN.
[[nodiscard]] SelectedMean select_most_frequent(std::span<const Sample> samples,
                                                const SelectionOptions& options = {});

/// The robust alternative: Huber's estimate of location over all intensities, after abnormal values only.
[[nodiscard]] SelectedMean select_robust(std::span<const Sample> samples,
                                         const SelectionOptions& options = {});

/// Mean and spread of the samples of one intensity.
struct IntensityClass {
  double intensity = 0, mean_mm = 0, sd_mm = 0;
  long n = 0;
};

/// All intensities of the accepted samples, each with its own mean and spread (heteroscedastic), ascending.
/// Classes of fewer than `least` samples are joined with the next one.
[[nodiscard]] std::vector<IntensityClass> by_intensity(std::span<const Sample> samples, long least = 30,
                                                       const SelectionOptions& options = {});

/// Probability at which steady samples count as drifting.
inline constexpr double chance_of_drift = 1e-3;

/// How many values one independent value is worth of an autocorrelated series: 1 + 2 * (sum of its
/// autocorrelations, up to the first that chance could make). 1 for white noise.
[[nodiscard]] double correlation_time(std::span<const double> values);

}  // namespace fit
