// SPDX-License-Identifier: MIT
#include <cmath>
#include <cstdio>

#include "fit/numeric/angle.hpp"
#include "fit/range/family.hpp"

namespace fit::families {
namespace {

// Radians over half the range: from a twentieth of a period over the whole range to five periods. Slower is a
// polynomial of the fourth degree, faster is a cyclic error and no longer a smooth trend.
constexpr double slowest = 0.05 * pi, fastest = 5 * pi;

void basis(const Eigen::VectorXd& t, const Eigen::VectorXd& beta, Eigen::MatrixXd& phi,
           std::vector<Eigen::MatrixXd>* dphi) {
  const double w = beta[0];
  phi.col(0).setOnes();
  phi.col(1) = (w * t.array()).cos();
  phi.col(2) = (w * t.array()).sin();
  phi.col(3) = 2 * phi.col(1).array().square() - 1;
  phi.col(4) = 2 * phi.col(1).cwiseProduct(phi.col(2));
  if (!dphi) return;
  Eigen::MatrixXd& d = (*dphi)[0];
  d.col(0).setZero();
  d.col(1) = -phi.col(2).cwiseProduct(t);
  d.col(2) = phi.col(1).cwiseProduct(t);
  d.col(3) = -2 * phi.col(4).cwiseProduct(t);
  d.col(4) = 2 * phi.col(3).cwiseProduct(t);
}

std::vector<std::string> remarks(const ArgumentScale& s, const Eigen::VectorXd& beta, SeparableFit::End) {
  const double period = 2 * pi * s.half / beta[0];
  if (period <= 2 * s.half * 1.5) return {};
  char text[240];
  std::snprintf(
      text, sizeof text,
      "a full period is %.3g, %.1f times the calibrated range: over that range it is a smooth polynomial in "
      "disguise, and its six coefficients are strongly correlated",
      period, period / (2 * s.half));
  return {text};
}

}  // namespace

Family make_fourier_2() {
  Family f;
  f.id = "fourier-2";
  f.title = "Fourier(2)";
  f.coefficients = {"a0", "a1", "b1", "a2", "b2", "w"};
  f.constant_column = 0;
  f.equation = "a0 + a1 * cos(w * x) + b1 * sin(w * x) + a2 * cos(2 * w * x) + b2 * sin(2 * w * x)";
  f.derivatives = {
      "1",
      "cos(w * x)",
      "sin(w * x)",
      "cos(2 * w * x)",
      "sin(2 * w * x)",
      "x * (b1 * cos(w * x) - a1 * sin(w * x) + 2 * b2 * cos(2 * w * x) - 2 * a2 * sin(2 * w * x))"};
  f.constant = 0;
  f.value = [](std::span<const double> p, double x) {
    const double z = p[5] * x;
    return p[0] + p[1] * std::cos(z) + p[2] * std::sin(z) + p[3] * std::cos(2 * z) + p[4] * std::sin(2 * z);
  };
  f.gradient = [](std::span<const double> p, double x, std::span<double> g) {
    const double z = p[5] * x;
    g[0] = 1, g[1] = std::cos(z), g[2] = std::sin(z), g[3] = std::cos(2 * z), g[4] = std::sin(2 * z);
    g[5] = x * (p[2] * g[1] - p[1] * g[2] + 2 * p[4] * g[3] - 2 * p[3] * g[4]);
  };
  f.model = [](const ArgumentScale&) {
    SeparableModel m;
    m.linear = 5, m.nonlinear = 1;
    m.basis = basis;
    m.lower = Eigen::VectorXd::Constant(1, slowest);
    m.upper = Eigen::VectorXd::Constant(1, fastest);
    return m;
  };
  f.starts = [](const ArgumentScale&) {
    std::vector<Eigen::VectorXd> out;
    for (double w = 1.2 * slowest; w < fastest; w = std::min(w * 1.25, w + 0.6))
      out.push_back(Eigen::VectorXd::Constant(1, w));
    return out;
  };
  f.publish = [](const ArgumentScale& s, const Eigen::VectorXd& beta, const Eigen::VectorXd& c) {
    const double w = beta[0] / s.half, z = w * s.centre;
    const double c1 = std::cos(z), s1 = std::sin(z), c2 = std::cos(2 * z), s2 = std::sin(2 * z);
    return std::vector<double>{
        c[0], c[1] * c1 - c[2] * s1, c[1] * s1 + c[2] * c1, c[3] * c2 - c[4] * s2, c[3] * s2 + c[4] * c2, w};
  };
  f.remarks = remarks;
  return f;
}

}  // namespace fit::families
