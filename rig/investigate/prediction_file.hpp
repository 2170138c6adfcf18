// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "fit/explain/experiment/forecast.hpp"
#include "fit/explain/explanation.hpp"
#include "rig/investigate/decision.hpp"

namespace rig::investigate {

/// Planned captures as they will follow on what is recorded: later, and with the lidar on for longer.
[[nodiscard]] std::vector<fit::CaptureInfo> after(const std::vector<fit::CaptureInfo>& so_far,
                                                  std::vector<fit::CaptureInfo> planned);

/// What is written down before a session is recorded (`prediction/1`, docs/operate/investigate.md): what was
/// found, in words and as a bench file, and what every beam will show.
[[nodiscard]] nlohmann::json prediction_document(const fit::explain::Explanation& found,
                                                 const std::vector<fit::CaptureInfo>& planned,
                                                 const fit::explain::Forecast& forecast,
                                                 const std::string& title);

struct WrittenPrediction {
  fit::explain::Forecast forecast;
  fit::Bench twin;
};
/// Reads it back. Throws UsageError, naming `file`, where it is no such document.
[[nodiscard]] WrittenPrediction read_prediction(const std::string& text, const std::string& file);

/// How it came out, with what pictures need.
[[nodiscard]] nlohmann::json comparison_document(const fit::explain::ForecastScore& score,
                                                 const fit::explain::Prediction& gain,
                                                 const Confirmation& judged);

}  // namespace rig::investigate
