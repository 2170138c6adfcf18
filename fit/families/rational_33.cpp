// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "fit/range/family.hpp"

namespace fit::families {
namespace {

using Eigen::ArrayXd;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// The denominator is (1 - u t)(1 + v t + w t^2): a root may be at infinity (u = 0, w = 0) but not inside the
// calibrated range, where it would be a pole.
constexpr double nearest = 0.995;      // 1 / root.
constexpr double least_share = 0.005;  // Of the quadratic factor's largest value on [-1, 1].

bool no_pole(const VectorXd& beta) {
  const double v = beta[1], w = beta[2];
  double least = std::min(1 - v + w, 1 + v + w);
  const double most = std::max({1 - v + w, 1 + v + w, 1.0});
  if (w > 0 && std::abs(v) < 2 * w) least = std::min(least, 1 - v * v / (4 * w));
  return least >= least_share * most;
}

void basis(const VectorXd& t, const VectorXd& beta, MatrixXd& phi, std::vector<MatrixXd>* dphi) {
  const ArrayXd first = 1 - beta[0] * t.array(),
                second = 1 + beta[1] * t.array() + beta[2] * t.array().square();
  phi.col(0) = 1 / (first * second);
  for (int j = 1; j < 4; ++j) phi.col(j) = phi.col(j - 1).cwiseProduct(t);
  if (!dphi) return;
  const ArrayXd by_u = t.array() / first, by_v = -t.array() / second, by_w = by_v * t.array();
  for (int j = 0; j < 4; ++j) {
    (*dphi)[0].col(j) = phi.col(j).array() * by_u;
    (*dphi)[1].col(j) = phi.col(j).array() * by_v;
    (*dphi)[2].col(j) = phi.col(j).array() * by_w;
  }
}

std::vector<VectorXd> starts(const ArgumentScale&) {
  std::vector<VectorXd> out;
  for (const double u : {-0.97, -0.8, -0.4, 0.1, 0.5, 0.85, 0.98})
    for (const auto& [v, w] : std::initializer_list<std::pair<double, double>>{{0.0, 0.0},
                                                                               {0.0, 1.0},
                                                                               {0.0, 12.0},
                                                                               {-1.2, 0.4},
                                                                               {1.2, 0.4},
                                                                               {-1.8, 0.84},
                                                                               {1.8, 0.84},
                                                                               {2.0, 4.0},
                                                                               {-2.0, 4.0}})
      out.push_back(Eigen::Vector3d(u, v, w));
  return out;
}

/// Multiplies polynomials given by ascending coefficients.
std::vector<double> product(const std::vector<double>& a, const std::vector<double>& b) {
  std::vector<double> out(a.size() + b.size() - 1);
  for (std::size_t i = 0; i < a.size(); ++i)
    for (std::size_t j = 0; j < b.size(); ++j) out[i + j] += a[i] * b[j];
  return out;
}

/// sum_j c_j ((x - m) / h)^j as ascending powers of x.
std::vector<double> unscaled(const std::vector<double>& c, const ArgumentScale& s) {
  std::vector<double> out(c.size());
  std::vector<double> power = {1};
  const std::vector<double> t = {-s.centre / s.half, 1 / s.half};
  for (const double coefficient : c) {
    for (std::size_t i = 0; i < power.size(); ++i) out[i] += coefficient * power[i];
    if (power.size() < c.size()) power = product(power, t);
  }
  return out;
}

std::vector<double> publish(const ArgumentScale& s, const VectorXd& beta, const VectorXd& c) {
  const auto numerator = unscaled({c[0], c[1], c[2], c[3]}, s);
  auto denominator = unscaled(product({1, -beta[0]}, {1, beta[1], beta[2]}), s);
  // A denominator of lower degree has no monic cubic form; its root is then put very far away.
  const double reach = std::abs(s.centre) + s.half;
  const double least = 1e-9 * std::abs(denominator[0]) / (reach * reach * reach);
  if (std::abs(denominator[3]) < least) denominator[3] = std::copysign(least, denominator[3]);
  const double monic = denominator[3];
  return {numerator[3] / monic,   numerator[2] / monic,   numerator[1] / monic,  numerator[0] / monic,
          denominator[2] / monic, denominator[1] / monic, denominator[0] / monic};
}

std::vector<std::string> remarks(const ArgumentScale&, const VectorXd& beta, SeparableFit::End) {
  std::vector<std::string> out;
  if (std::abs(beta[0]) < 1e-3 || std::abs(beta[2]) < 1e-3)
    out.emplace_back("a root of its denominator is far outside the range: a lower degree says the same");
  double near = 1 - std::abs(beta[0]);
  near = std::min({near, 1 - beta[1] + beta[2], 1 + beta[1] + beta[2]});
  if (near < 0.02)
    out.emplace_back(
        "its denominator has a root just outside the range: a pole follows an end point rather than a trend");
  return out;
}

}  // namespace

Family make_rational_33() {
  Family f;
  f.id = "rational-33";
  f.title = "rational(3,3)";
  f.coefficients = {"p1", "p2", "p3", "p4", "q1", "q2", "q3"};
  f.constant_column = 0;
  f.equation = "(((p1 * x + p2) * x + p3) * x + p4) / (((x + q1) * x + q2) * x + q3)";
  const std::string below = "(((x + q1) * x + q2) * x + q3)", above = "(((p1 * x + p2) * x + p3) * x + p4)";
  for (const char* power : {"x * x * x", "x * x", "x", "1"})
    f.derivatives.push_back(std::string(power) + " / " + below);
  for (const char* power : {"x * x", "x", "1"})
    f.derivatives.push_back("-(" + std::string(power) + ") * " + above + " / (" + below + " * " + below +
                            ")");
  f.value = [](std::span<const double> p, double x) {
    return (((p[0] * x + p[1]) * x + p[2]) * x + p[3]) / (((x + p[4]) * x + p[5]) * x + p[6]);
  };
  f.gradient = [](std::span<const double> p, double x, std::span<double> g) {
    const double low = ((x + p[4]) * x + p[5]) * x + p[6],
                 y = (((p[0] * x + p[1]) * x + p[2]) * x + p[3]) / low;
    g[3] = 1 / low, g[2] = x / low, g[1] = x * x / low, g[0] = x * x * x / low;
    g[6] = -y / low, g[5] = -x * y / low, g[4] = -x * x * y / low;
  };
  f.model = [](const ArgumentScale&) {
    SeparableModel m;
    m.linear = 4, m.nonlinear = 3;
    m.basis = basis;
    m.lower = Eigen::Vector3d(-nearest, -40, -400);
    m.upper = Eigen::Vector3d(nearest, 40, 400);
    m.feasible = no_pole;
    return m;
  };
  f.starts = starts;
  f.publish = publish;
  f.remarks = remarks;
  return f;
}

}  // namespace fit::families
