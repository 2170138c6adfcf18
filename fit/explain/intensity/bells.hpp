// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

namespace fit::explain::intensity {

/// Largest less least of the finite values; 0 where they do not differ.
[[nodiscard]] double span_of(const Eigen::VectorXd& x);

/// Bells along x (rows as those of x, 0 where it is not finite), `length` apart in the unit of x; together a
/// smooth function of standard size one and that correlation length. No columns where x does not differ.
[[nodiscard]] Eigen::MatrixXd bells(const Eigen::VectorXd& x, double length);

}  // namespace fit::explain::intensity
