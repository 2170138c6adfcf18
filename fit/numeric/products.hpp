// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

/// Products of matrices of long columns, with the widest vectors that the processor has: Eigen takes those
/// that every processor has.
namespace fit {

/// a' b (p x q). a: n x p; b: n x q.
[[nodiscard]] Eigen::MatrixXd transpose_product(const Eigen::Ref<const Eigen::MatrixXd>& a,
                                                const Eigen::Ref<const Eigen::MatrixXd>& b);

/// a' a (p x p). a: n x p.
[[nodiscard]] Eigen::MatrixXd square_of_columns(const Eigen::Ref<const Eigen::MatrixXd>& a);

}  // namespace fit
