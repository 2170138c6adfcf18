// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/recording.hpp"

namespace fit::explain {

/// What one beam of a capture that is not made yet will show.
struct PredictedBeam {
  int capture = 0;  ///< Index among the planned ones.
  double beam_rad = 0, incidence_rad = 0;
  double range_mm = 0;  ///< Expected mean of its samples.
  double u_mm =
      0;  ///< Standard uncertainty of that: of where things stand, and of the sizes that were found.
  double sd_mm = 0;  ///< Standard deviation of one sample about the mean.
};

/// A predicted recording: the beams that meet one surface squarely enough, away from edges and corners.
struct Forecast {
  std::vector<PredictedBeam> beams;
};

/// Predicts captures by a bench file that knows what was found (`Explanation::bench`). What is not known of
/// it is what the recordings leave open from which it was learnt: the posterior covariance of mount, targets
/// and sizes of known mechanisms, linearised (GUM, 5.2), is propagated to every beam. Throws
/// std::invalid_argument when no beam meets a target.
[[nodiscard]] Forecast forecast(const Bench& twin, const std::vector<CaptureInfo>& planned,
                                const std::vector<const Recording*>& learnt_from);

/// How a forecast came true.
struct ForecastScore {
  long samples = 0;
  double coverage_95 = 0;               ///< Share of samples within their predicted 95 % interval.
  double coverage_95_of_means = 0;      ///< The same for the means of beams.
  double rms_mm = 0;                    ///< Of samples minus forecast.
  double rms_of_means_mm = 0;           ///< Of means minus forecast.
  double expected_rms_of_means_mm = 0;  ///< What that should be by the stated uncertainties.
  struct Beam {
    double beam_deg = 0, range_mm = 0, mean_minus_forecast_mm = 0, u_mm = 0;
  };
  std::vector<Beam> beams;  ///< Those that were predicted and recorded.
};

/// Lays the recording beside the forecast; nothing is fitted. `recorded` has the captures that were planned,
/// in order; `twin` is the forecast's. Throws std::invalid_argument when no predicted beam was recorded.
[[nodiscard]] ForecastScore score(const Forecast& forecast, const Bench& twin, const Recording& recorded);

}  // namespace fit::explain
