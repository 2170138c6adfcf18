// SPDX-License-Identifier: MIT
/// Decompositions of dense matrices, compiled once: every matrix type that instantiates one of Eigen's own
/// costs the compiler 2 to 7 s. For small systems outside inner loops; what runs hot uses Eigen directly.
#pragma once

#include <Eigen/Core>

namespace fit::dense {

/// x of `a` x = `b`; `a` (n x n) is symmetric and positive semi-definite (L D L^T with pivots). b: n x m.
Eigen::MatrixXd solve_symmetric(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

/// x that minimises |`a` x - `b`| (QR with column pivots). a: n x m, n >= m; b: n.
Eigen::VectorXd least_squares(const Eigen::MatrixXd& a, const Eigen::VectorXd& b);

/// Of a regular matrix (n x n), by LU with partial pivots.
Eigen::MatrixXd inverse(const Eigen::MatrixXd& a);

/// Moore-Penrose, by complete orthogonal decomposition: directions with less than 1e-12 of the
/// strongest one's information count as having none.
Eigen::MatrixXd pseudo_inverse(const Eigen::MatrixXd& a);

/// Lower triangle L of `a` = L L^T; `a` (n x n) is symmetric and positive definite.
Eigen::MatrixXd cholesky(const Eigen::MatrixXd& a);

struct SymmetricEigen {
  Eigen::VectorXd values;   ///< Ascending.
  Eigen::MatrixXd vectors;  ///< A column each, of length one.
};
/// Of a symmetric matrix (n x n).
SymmetricEigen symmetric_eigen(const Eigen::MatrixXd& a);

/// Orthonormal columns that span those of `a` (QR with column pivots): rows(a) x rank.
Eigen::MatrixXd orthonormal_basis(const Eigen::MatrixXd& a);

struct RightSingular {
  Eigen::VectorXd values;   ///< Descending.
  Eigen::MatrixXd vectors;  ///< V of `a` = U S V^T, a column each.
};
RightSingular right_singular(const Eigen::MatrixXd& a);

}  // namespace fit::dense
