// SPDX-License-Identifier: MIT
#include "fit/range/family.hpp"

namespace fit::families {

Family make_constant() {
  Family f;
  f.id = "constant";
  f.title = "constant";
  f.coefficients = {"a"};
  f.constant_column = 0;
  f.equation = "a";
  f.derivatives = {"1"};
  f.constant = 0;
  f.value = [](std::span<const double> a, double) { return a[0]; };
  f.gradient = [](std::span<const double>, double, std::span<double> g) { g[0] = 1; };
  f.model = [](const ArgumentScale&) {
    SeparableModel m;
    m.linear = 1;
    m.basis = [](const Eigen::VectorXd&, const Eigen::VectorXd&, Eigen::MatrixXd& phi,
                 std::vector<Eigen::MatrixXd>*) { phi.setOnes(); };
    return m;
  };
  f.publish = [](const ArgumentScale&, const Eigen::VectorXd&, const Eigen::VectorXd& c) {
    return std::vector<double>{c[0]};
  };
  return f;
}

}  // namespace fit::families
