// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "fit/numeric/estimate.hpp"

namespace fit {

/// One part of a range correction: a curve over the echo's intensity or over the range.
struct CorrectionTerm {
  enum class Argument { intensity, range };
  Argument argument = Argument::range;
  std::string family;
  std::vector<double> coefficients;
  double from = 0, to = 0;        ///< Where it was calibrated: the means that it was fitted to.
  std::optional<double> zero_at;  ///< The curve counts from its value here; none: as it is.
  /// Where single samples of those means lie, noise included: at the border, half of them would be outside
  /// `from` and `to`, and those that remain would be wrong on one side. None: `from` and `to`.
  std::optional<double> sample_from, sample_to;
  [[nodiscard]] double lowest() const { return sample_from.value_or(from); }
  [[nodiscard]] double highest() const { return sample_to.value_or(to); }

  [[nodiscard]] double value(double x) const;
  /// With respect to the coefficients; same errors as value().
  [[nodiscard]] std::vector<double> gradient(double x) const;
};

/// The circumstances in which a correction was measured; what is absent was not stated. It says nothing of
/// others.
struct Validity {
  struct Interval {
    double from = 0, to = 0;
    [[nodiscard]] bool holds(double x) const { return x >= from && x <= to; }
    void include(double x) { from = std::min(from, x), to = std::max(to, x); }
  };
  std::optional<Interval> range_mm;       ///< True distances.
  std::optional<Interval> intensity;      ///< Counts.
  std::optional<Interval> beam_deg;       ///< Of the beams whose ranges were used, in the lidar's frame.
  std::optional<Interval> temperature_c;  ///< Of the lidar's housing.
};

/// What to subtract from a measured range (source A: L_Q = (1 + k) L + u, gathered in one error curve).
///
///   error = zero + intensity term (I) + range term (r),  r = measured - zero - intensity term
///
/// Either term may be missing. Its covariance is kept as a factor, which holds twice the digits.
struct Correction {
  Estimate zero_mm{0, 0};  ///< At the reference condition.
  std::optional<CorrectionTerm> intensity, range;
  Eigen::MatrixXd factor;  ///< Rows: zero, the intensity term's coefficients, the range term's.
  double common_u_mm = 0;  ///< Of the true distances: the same for every range, not in `factor`.
  double reference_mm = 200, reference_intensity = 2400;
  std::string lidar_model, lidar_serial, lidar_firmware;
  std::string created_utc, procedure, software;
  std::vector<std::string> session_sha256;
  Validity validity;
  /// The echoes that were measured at one distance.
  struct Measured {
    double range_mm = 0;
    double from = 0, to = 0;  ///< Counts.
  };
  std::vector<Measured> measured;  ///< By distance, ascending; empty: not stated, as in older files.
  std::vector<std::string> notes;  ///< What a user must know.

  struct Corrected {
    double range_mm = 0;  ///< Corrected. Outside the calibrated region: by the error at its border.
    double error_mm = 0;  ///< That was subtracted.
    /// Where the correction has no term for one of them, it was measured only as `measured` says: at those
    /// distances (within 5 %), and with echoes of those surfaces (their counts at that distance, within 25
    /// %).
    bool range_outside = false, intensity_outside = false;
    [[nodiscard]] bool inside() const { return !range_outside && !intensity_outside; }
  };
  [[nodiscard]] Corrected apply(double range_mm, double intensity) const;
  /// Whether echoes of that strength were measured about that distance, by `measured` alone.
  [[nodiscard]] bool surface_measured(double range_mm, double intensity) const;
  static constexpr double measured_distances = 0.05, measured_counts = 0.25;  ///< Shares that are still near.
  /// Standard uncertainty of the error that apply() subtracts (not of one sample's noise).
  [[nodiscard]] double u(double range_mm, double intensity) const;
  [[nodiscard]] std::vector<std::string> parameter_names() const;
};

/// As JSON (`correction/1`, docs/reference/correction.md), every number with all its digits.
[[nodiscard]] std::string to_json_text(const Correction& correction);

/// Reads `correction/1`. Throws std::invalid_argument that names the place, what was expected and what to do.
[[nodiscard]] Correction parse_correction(const std::string& text, const std::string& name = "correction");

}  // namespace fit
