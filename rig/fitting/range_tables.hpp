// SPDX-License-Identifier: MIT
#pragma once
// Tables and plots of the result `range`.

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "fit/range/range_calibration.hpp"
#include "rig/fitting/range_source.hpp"

namespace rig::range_parts {

nlohmann::json captures_table(const RangeSource& source);
nlohmann::json robust_table(const RangeSource& source);
nlohmann::json selection_table(const RangeSource& source);
/// The paper's table: the same figures of the same five families, in its order.
/// `robust`: whether its points are the means of all samples, else those of the most frequent intensity.
nlohmann::json paper_table(const fit::RangeCalibration& calibration, bool robust);
/// The families as they predict; what there is to say about one follows in a table of its own.
void add_families(nlohmann::json& tables, const std::vector<fit::FamilyFit>& fits, const std::string& title);
nlohmann::json coefficients_table(const fit::Correction& c);
/// Joint against sequential along the points.
nlohmann::json methods_table(const fit::RangeCalibration& calibration,
                             const std::vector<fit::RangePoint>& points, double& largest);
nlohmann::json points_plot(const std::vector<fit::RangePoint>& points, const fit::Correction* correction,
                           bool over_intensity);

}  // namespace rig::range_parts
