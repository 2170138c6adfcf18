// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/range/family.hpp"

namespace fit::families {
namespace {

constexpr double largest_power = 12;
constexpr double least_power = 1e-4;

/// x^b over x's largest value, and (x^b - 1) / b near b = 0, where x^b and the constant become one.
struct Basis {
  ArgumentScale scale;
  void operator()(const Eigen::VectorXd& t, const Eigen::VectorXd& beta, Eigen::MatrixXd& phi,
                  std::vector<Eigen::MatrixXd>* dphi) const {
    const double b = std::abs(beta[0]) < least_power ? std::copysign(least_power, beta[0]) : beta[0];
    // Relative to the middle of the range; negative powers grow to its near end, positive ones to its far
    // end.
    const Eigen::ArrayXd log_x = ((t.array() * scale.half + scale.centre) / scale.centre).log();
    const Eigen::ArrayXd power = (b * log_x).exp();
    phi.col(0).setOnes();
    phi.col(1) = (power - 1) / b;
    if (!dphi) return;
    (*dphi)[0].col(0).setZero();
    (*dphi)[0].col(1) = (power * log_x * b - (power - 1)) / (b * b);
  }
};

}  // namespace

Family make_power_2() {
  Family f;
  f.id = "power-2";
  f.title = "power(2)";
  f.coefficients = {"a", "b", "c"};
  f.constant_column = 0;
  f.equation = "a * pow(x, b) + c";
  f.derivatives = {"pow(x, b)", "a * log(x) * pow(x, b)", "1"};
  f.constant = 2;
  f.positive_argument = true;
  f.value = [](std::span<const double> p, double x) { return p[0] * std::pow(x, p[1]) + p[2]; };
  f.gradient = [](std::span<const double> p, double x, std::span<double> g) {
    g[0] = std::pow(x, p[1]), g[1] = p[0] * std::log(x) * g[0], g[2] = 1;
  };
  f.model = [](const ArgumentScale& s) {
    SeparableModel m;
    m.linear = 2, m.nonlinear = 1;
    m.basis = Basis{s};
    m.lower = Eigen::VectorXd::Constant(1, -largest_power);
    m.upper = Eigen::VectorXd::Constant(1, largest_power);
    return m;
  };
  f.starts = [](const ArgumentScale&) {
    std::vector<Eigen::VectorXd> out;
    for (const double b : {-9.0, -5.0, -3.0, -2.0, -1.2, -0.6, -0.2, 0.2, 0.5, 0.9, 1.5, 2.5, 4.0, 7.0, 10.0})
      out.push_back(Eigen::VectorXd::Constant(1, b));
    return out;
  };
  f.publish = [](const ArgumentScale& s, const Eigen::VectorXd& beta, const Eigen::VectorXd& c) {
    const double b = std::abs(beta[0]) < least_power ? std::copysign(least_power, beta[0]) : beta[0];
    return std::vector<double>{c[1] / b * std::pow(s.centre, -b), b, c[0] - c[1] / b};
  };
  f.remarks = [](const ArgumentScale&, const Eigen::VectorXd& beta, SeparableFit::End) {
    std::vector<std::string> out;
    if (std::abs(beta[0]) < 0.02)
      out.emplace_back("the power is nearly 0: it is a logarithm, and the power and the constant cancel");
    return out;
  };
  return f;
}

}  // namespace fit::families
