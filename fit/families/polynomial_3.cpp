// SPDX-License-Identifier: MIT
#include "fit/range/family.hpp"

namespace fit::families {

// Coefficients in descending powers, as curve-fitting tools name them.
Family make_polynomial_3() {
  Family f;
  f.id = "polynomial-3";
  f.title = "polynomial(3)";
  f.coefficients = {"p1", "p2", "p3", "p4"};
  f.constant_column = 0;
  f.equation = "((p1 * x + p2) * x + p3) * x + p4";
  f.derivatives = {"x * x * x", "x * x", "x", "1"};
  f.constant = 3;
  f.value = [](std::span<const double> p, double x) { return ((p[0] * x + p[1]) * x + p[2]) * x + p[3]; };
  f.gradient = [](std::span<const double>, double x, std::span<double> g) {
    g[0] = x * x * x, g[1] = x * x, g[2] = x, g[3] = 1;
  };
  f.model = [](const ArgumentScale&) {
    SeparableModel m;
    m.linear = 4;
    m.basis = [](const Eigen::VectorXd& t, const Eigen::VectorXd&, Eigen::MatrixXd& phi,
                 std::vector<Eigen::MatrixXd>*) {
      phi.col(0).setOnes();
      for (int j = 1; j < 4; ++j) phi.col(j) = phi.col(j - 1).cwiseProduct(t);
    };
    return m;
  };
  // Powers of (x - centre) / half multiplied out.
  f.publish = [](const ArgumentScale& s, const Eigen::VectorXd&, const Eigen::VectorXd& c) {
    const double h = 1 / s.half, m = s.centre;
    const double c1 = c[1] * h, c2 = c[2] * h * h, c3 = c[3] * h * h * h;
    return std::vector<double>{c3, c2 - 3 * c3 * m, c1 - 2 * c2 * m + 3 * c3 * m * m,
                               c[0] - c1 * m + c2 * m * m - c3 * m * m * m};
  };
  return f;
}

}  // namespace fit::families
