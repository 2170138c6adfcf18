// SPDX-License-Identifier: MIT
#include "fit/range/family.hpp"

namespace fit::families {

Family make_line() {
  Family f;
  f.id = "line";
  f.title = "straight line";
  f.coefficients = {"a", "b"};
  f.constant_column = 0;
  f.equation = "a + b * x";
  f.derivatives = {"1", "x"};
  f.constant = 0;
  f.value = [](std::span<const double> a, double x) { return a[0] + a[1] * x; };
  f.gradient = [](std::span<const double>, double x, std::span<double> g) { g[0] = 1, g[1] = x; };
  f.model = [](const ArgumentScale&) {
    SeparableModel m;
    m.linear = 2;
    m.basis = [](const Eigen::VectorXd& t, const Eigen::VectorXd&, Eigen::MatrixXd& phi,
                 std::vector<Eigen::MatrixXd>*) {
      phi.col(0).setOnes();
      phi.col(1) = t;
    };
    return m;
  };
  f.publish = [](const ArgumentScale& s, const Eigen::VectorXd&, const Eigen::VectorXd& c) {
    return std::vector<double>{c[0] - c[1] * s.centre / s.half, c[1] / s.half};
  };
  return f;
}

}  // namespace fit::families
