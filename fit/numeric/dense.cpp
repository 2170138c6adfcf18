// SPDX-License-Identifier: MIT
#include "fit/numeric/dense.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>

namespace fit::dense {

using Eigen::MatrixXd;

MatrixXd solve_symmetric(const MatrixXd& a, const MatrixXd& b) { return a.ldlt().solve(b); }

Eigen::VectorXd least_squares(const MatrixXd& a, const Eigen::VectorXd& b) {
  return a.colPivHouseholderQr().solve(b);
}

MatrixXd inverse(const MatrixXd& a) { return a.inverse(); }

MatrixXd pseudo_inverse(const MatrixXd& a) {
  Eigen::CompleteOrthogonalDecomposition<MatrixXd> decomposition;
  // Above what rounding leaves of a direction without information, below what any measurement tells.
  decomposition.setThreshold(1e-12);
  return decomposition.compute(a).pseudoInverse();
}

MatrixXd cholesky(const MatrixXd& a) { return a.llt().matrixL(); }

SymmetricEigen symmetric_eigen(const MatrixXd& a) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(a);
  return {eigen.eigenvalues(), eigen.eigenvectors()};
}

MatrixXd orthonormal_basis(const MatrixXd& a) {
  const Eigen::ColPivHouseholderQR<MatrixXd> qr(a);
  return MatrixXd(qr.householderQ()).leftCols(qr.rank());
}

RightSingular right_singular(const MatrixXd& a) {
  const Eigen::JacobiSVD<MatrixXd> svd(a, Eigen::ComputeFullV);
  return {svd.singularValues(), svd.matrixV()};
}

}  // namespace fit::dense
