// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "fit/numeric/estimate.hpp"

namespace rig {

/// Builds the parts of a `result/1` document (docs/reference/result.md).

[[nodiscard]] nlohmann::json new_result(const std::string& kind, const std::string& method);

/// One entry of "values". `freedom`: effective degrees of freedom; 0 = many, k = 2.
[[nodiscard]] nlohmann::json result_value(const std::string& name, const std::string& label,
                                          const fit::Estimate& estimate, const std::string& unit,
                                          double freedom = 0);
/// A value that carries no uncertainty of its own (a count, a probability).
[[nodiscard]] nlohmann::json plain_value(const std::string& name, const std::string& label, double value,
                                         const std::string& unit);

[[nodiscard]] nlohmann::json budget_line(const std::string& source, const std::string& type, double u,
                                         const std::string& unit);

/// Standard uncertainty of a reading in whole steps of `resolution`: a rectangular distribution as wide as
/// one step (GUM F.2.2.1).
[[nodiscard]] double u_of_resolution(double resolution);

/// The head of a table's column.
[[nodiscard]] nlohmann::json column(const std::string& name, const std::string& unit);

/// Numbers that JSON cannot hold become null.
[[nodiscard]] nlohmann::json number_or_null(double value);
[[nodiscard]] nlohmann::json numbers(const std::vector<double>& values);

[[nodiscard]] nlohmann::json new_plot(const std::string& title, const std::string& x_label,
                                      const std::string& y_label);
void add_series(nlohmann::json& plot, const std::string& name, const std::string& style,
                const std::vector<double>& x, const std::vector<double>& y,
                const std::vector<double>& u = {});

}  // namespace rig
