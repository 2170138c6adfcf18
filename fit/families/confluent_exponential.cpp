// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/range/family.hpp"

namespace fit::families {
namespace {

constexpr double steepest = 20;  // Half the range holds at most e^20.

void basis(const Eigen::VectorXd& t, const Eigen::VectorXd& beta, Eigen::MatrixXd& phi,
           std::vector<Eigen::MatrixXd>* dphi) {
  phi.col(0) = (-beta[0] * t.array() - std::abs(beta[0])).exp();
  phi.col(1) = phi.col(0).cwiseProduct(t);
  if (!dphi) return;
  (*dphi)[0].col(0) = -phi.col(1);
  (*dphi)[0].col(1) = -phi.col(1).cwiseProduct(t);
}

}  // namespace

// What two exponentials of nearly equal rates are numerically (source A, equation 14).
Family make_confluent_exponential() {
  Family f;
  f.id = "confluent-exponential";
  f.title = "confluent exponential";
  f.coefficients = {"a", "b", "c"};
  f.equation = "(a + b * x) * exp(-c * x)";
  f.derivatives = {"exp(-c * x)", "x * exp(-c * x)", "-x * (a + b * x) * exp(-c * x)"};
  f.value = [](std::span<const double> p, double x) { return (p[0] + p[1] * x) * std::exp(-p[2] * x); };
  f.gradient = [](std::span<const double> p, double x, std::span<double> g) {
    g[0] = std::exp(-p[2] * x), g[1] = x * g[0], g[2] = -x * (p[0] + p[1] * x) * g[0];
  };
  f.model = [](const ArgumentScale&) {
    SeparableModel m;
    m.linear = 2, m.nonlinear = 1;
    m.basis = basis;
    m.lower = Eigen::VectorXd::Constant(1, -steepest);
    m.upper = Eigen::VectorXd::Constant(1, steepest);
    return m;
  };
  f.starts = [](const ArgumentScale&) {
    std::vector<Eigen::VectorXd> out;
    for (const double c : {-12.0, -6.0, -3.0, -1.5, -0.7, -0.2, 0.2, 0.7, 1.3, 2.0, 3.0, 4.5, 6.5, 9.0, 13.0})
      out.push_back(Eigen::VectorXd::Constant(1, c));
    return out;
  };
  f.publish = [](const ArgumentScale& s, const Eigen::VectorXd& beta, const Eigen::VectorXd& c) {
    const double rate = beta[0] / s.half, size = std::exp(rate * s.centre - std::abs(beta[0]));
    return std::vector<double>{size * (c[0] - c[1] * s.centre / s.half), size * c[1] / s.half, rate};
  };
  f.remarks = [](const ArgumentScale&, const Eigen::VectorXd& beta, SeparableFit::End) {
    std::vector<std::string> out;
    if (std::abs(beta[0]) < 0.05)
      out.emplace_back("it barely decays over the range: a straight line fits as well");
    return out;
  };
  return f;
}

}  // namespace fit::families
