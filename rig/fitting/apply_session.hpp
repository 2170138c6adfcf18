// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "fit/range/correction.hpp"
#include "rig/output_place.hpp"

namespace rig {

/// What the operator asked of `rig apply`.
struct ApplyRequest {
  fit::Correction correction;
  std::string correction_name, input;
  OutputPlace output;
  bool drop_outside = false;  ///< Samples outside the calibrated region become "no echo".
  bool any_lidar = false;     ///< Also when it was made for another lidar.
};

struct ApplyReport {
  long scans = 0, samples = 0, without_echo = 0;
  long outside_range = 0, outside_intensity = 0;  ///< A sample may count in both.
  double mean_error_mm = 0;                       ///< Subtracted, on average.
  std::vector<std::string> warnings;              ///< Sentences for the operator.
};

/// Writes a copy of the session with corrected ranges, rounded to whole millimetres as the format has them;
/// its results, which belong to the uncorrected ranges, are left out, and its key `correction` says what was
/// done. It appears whole or not at all. Throws UsageError (files, another lidar or one of another model,
/// corrected already) or MeasurementError (no intensities).
ApplyReport apply_to_session(const ApplyRequest& request);

}  // namespace rig
