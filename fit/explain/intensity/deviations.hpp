// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "fit/explain/intensity/model.hpp"
#include "fit/explain/intensity/suspicion.hpp"

/// How intensities deviate from the law that the bench claims, and what may make them deviate that is no
/// physics left out.
namespace fit::explain::intensity {

/// Prior sizes of coefficients of the law that are wrong, in the unit in which they are searched.
constexpr std::array<double, IntensityLaw::size> released{0.3, 0.3, 0.3, 0.3, 1.0, 0.5};

/// Derivatives of what is predicted by the law's coefficients, a column each.
[[nodiscard]] Eigen::MatrixXd law_columns(const Readings& readings, const IntensityLaw& law);

/// What may differ from any claim; the law's coefficients come first, and those among `accepted` are free.
[[nodiscard]] Block nuisances(const Readings& readings, const std::vector<Suspicion>& accepted,
                              const IntensityLaw& law);

/// How a mechanism that acts may move and bend around its values: its searched parameters come first.
[[nodiscard]] Block freedom_of(const Readings& readings, const Suspicion& suspicion);

/// Nuisances, and the freedom of everything accepted in its order.
[[nodiscard]] Block base_of(const Readings& readings, const std::vector<Suspicion>& accepted,
                            const IntensityLaw& law);

/// The deviations as everything accepted leaves them.
[[nodiscard]] Model model_of(const Readings& readings, const std::vector<Suspicion>& accepted);
/// The same, expanded at another law than the claimed one.
[[nodiscard]] Model model_of(const Readings& readings, const std::vector<Suspicion>& accepted,
                             const IntensityLaw& law);

}  // namespace fit::explain::intensity
