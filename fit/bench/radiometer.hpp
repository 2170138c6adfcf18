// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "fit/bench/bench.hpp"

namespace fit {

/// The law by which an echo becomes counts (lidar equation with an extended Lambertian target behind a
/// receiver that compresses; Wagner et al., ISPRS J. 60 (2006) 100; Kaasalainen et al., Remote Sens. 3 (2011)
/// 2207):
///
///   raw = counts_at_1m * reflectance^reflectance_power * cos(incidence)^incidence_power
///         * (1 m / r * r^2 / (r^2 + overlap^2))^range_power
///   counts = raw / hypot(1, raw / full_counts)
struct IntensityLaw {
  /// Searched as they are, but for `gain`, `overlap` and `full`, which are logarithms.
  enum Coefficient { gain, range_power, incidence_power, reflectance_power, overlap, full };
  static constexpr int size = 6;
  /// ln(counts at 1 m), three powers, ln(overlap in mm), ln(full counts).
  std::array<double, size> value{6.8, 1, 0.5, 0.5, 0, 20};

  [[nodiscard]] double log_counts(double reflectance, double cos_incidence, double range_mm) const;
  [[nodiscard]] double counts(double reflectance, double cos_incidence, double range_mm) const;
  /// Counts of an echo that is stronger by the exponential of that than one of so many.
  [[nodiscard]] double stronger(double counts, double log_echo) const;
  /// d ln(counts) / d ln(echo): one but where the receiver compresses.
  [[nodiscard]] double receiver_slope(double counts) const;

 private:
  /// ln(counts) by the logarithm of what they would be without compression.
  [[nodiscard]] double compressed(double log_raw) const;
};

/// The mechanism by which bench files state the law, and which a wrong law is called.
inline constexpr const char* law_of_intensity = "radiometry";

/// What a bench file claims about intensity: the `radiometry` entry of its known mechanisms, with parameters
/// `counts_at_1m`, `range_power`, `incidence_power`, `reflectance_power`, `overlap_mm`, `full_counts` and
/// `relative_noise`. What it does not state comes from the `sim` section's `intensity`, and failing that is
/// open. Corrections of the law in the same entry (fit/mechanisms/radiometry.cpp) act beside it.
struct IntensityClaim {
  IntensityLaw law;
  std::array<bool, IntensityLaw::size> stated{};
  std::array<double, IntensityLaw::size> u{};  ///< Of `law.value`, where stated.
  std::optional<double> relative_noise;        ///< Of one sample.
};

/// Nothing when the bench makes no claim: intensity is a covariate then, not something to explain.
[[nodiscard]] std::optional<IntensityClaim> claimed_intensity(const Bench& bench);
/// Takes corrections of the law that are a change of its coefficients (fit/mechanisms/radiometry.cpp) out of
/// the bench's entry; returns the law with them.
[[nodiscard]] IntensityLaw fold_corrections(Bench& bench, IntensityLaw law);
/// Puts the law into the bench's `radiometry` entry; `u` of its coefficients, 0 where they were not fitted.
void state_intensity(Bench& bench, const IntensityLaw& law, const std::array<double, IntensityLaw::size>& u,
                     std::optional<double> relative_noise);
/// How strong a twin's echoes are where the bench claims nothing: `intensity` in the section `sim` of a bench
/// file. A description for the simulator, never something to explain.
struct DescribedIntensity {
  IntensityLaw law;
  double relative_noise = 0.01;  ///< Of one sample.
  /// A surface that is brighter or darker than its nominal reflectance says.
  struct Surface {
    std::string target;
    double reflectance = 0, gain = 1;
  };
  std::vector<Surface> surfaces;

  [[nodiscard]] double gain(const std::string& target, double reflectance) const;
};
[[nodiscard]] std::optional<DescribedIntensity> described_intensity(const Bench& bench);
/// The law that a bench file claims, else the one it describes, else a plain receiver's.
[[nodiscard]] IntensityLaw law_of_bench(const Bench& bench);
void describe_intensity(Bench& bench, const DescribedIntensity& intensity);

/// The coefficient as files name it, and its value and uncertainty in the file's unit.
[[nodiscard]] const char* file_name(IntensityLaw::Coefficient coefficient);
[[nodiscard]] Estimate in_file_unit(IntensityLaw::Coefficient coefficient, const Estimate& estimate);

}  // namespace fit
