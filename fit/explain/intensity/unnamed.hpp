// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/intensity/deviations.hpp"

namespace fit::explain::intensity {

/// Shortest correlation length of an unnamed function, as a share of its coordinate's span.
constexpr double finest = 0.06;

/// Smooth functions of every coordinate that takes more than a few values, and of the places on every target
/// that is seen often enough. Their sizes are open.
[[nodiscard]] std::vector<Suspicion> smooth_functions(const Readings& readings);

/// The patch of every target whose intensity deviates most from that of the rest. Their sizes are open.
[[nodiscard]] std::vector<Suspicion> patches(const Readings& readings, const Model& model);

/// The best size of an unnamed function on top of the model's base.
void find_size(const Readings& readings, const Model& model, Suspicion& unnamed);

/// An accepted unnamed function as it came out, row by row.
[[nodiscard]] Eigen::VectorXd function_of(const Readings& readings, const std::vector<Suspicion>& accepted,
                                          const Suspicion& unnamed);

}  // namespace fit::explain::intensity
