// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/range/family.hpp"

namespace fit::families {
namespace {

using Eigen::ArrayXd;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double steepest = 20;       // Half the range holds at most e^20.
constexpr double least_apart = 1e-4;  // Nearer rates are one: the confluent form.
constexpr double separate = 0.5;      // From here on the two exponentials themselves are the better basis.

/// The rates are m + d and m - d with q = d^2. Where they are close, cosh and sinh/d span the same curves and
/// stay apart; at d = 0 they are 1 and t, the confluent form.
void basis(const VectorXd& t, const VectorXd& beta, MatrixXd& phi, std::vector<MatrixXd>* dphi) {
  const double m = beta[0], q = std::max(beta[1], least_apart * least_apart), d = std::sqrt(q);
  if (d >= separate) {
    const double fast = m + d, slow = m - d;
    phi.col(0) = (fast * t.array() - std::abs(fast)).exp();
    phi.col(1) = (slow * t.array() - std::abs(slow)).exp();
    if (!dphi) return;
    for (int j = 0; j < 2; ++j) (*dphi)[0].col(j) = phi.col(j).cwiseProduct(t);
    (*dphi)[1].col(0) = (*dphi)[0].col(0) / (2 * d);
    (*dphi)[1].col(1) = -(*dphi)[0].col(1) / (2 * d);
    return;
  }
  const ArrayXd envelope = (m * t.array() - std::abs(m)).exp();
  const ArrayXd z = d * t.array(), z2 = z.square();
  // sinh(z)/z and its derivative by z^2, by their series: |z| < 0.5 makes eight terms exact.
  ArrayXd sinch = ArrayXd::Ones(t.size()), dsinch = ArrayXd::Zero(t.size());
  double factorial = 1;
  ArrayXd power = ArrayXd::Ones(t.size());
  for (int k = 1; k <= 8; ++k) {
    factorial *= 2 * k * (2 * k + 1);
    dsinch += k * power / factorial;
    power *= z2;
    sinch += power / factorial;
  }
  const ArrayXd cosh = z.cosh();
  phi.col(0) = envelope * cosh;
  phi.col(1) = envelope * t.array() * sinch;
  if (!dphi) return;
  (*dphi)[0].col(0) = phi.col(0).cwiseProduct(t);
  (*dphi)[0].col(1) = phi.col(1).cwiseProduct(t);
  (*dphi)[1].col(0) = envelope * t.array().square() * sinch / 2;
  (*dphi)[1].col(1) = envelope * t.array().cube() * dsinch;
}

std::vector<VectorXd> starts(const ArgumentScale&) {
  std::vector<VectorXd> out;
  for (const double fast : {-12.0, -6.0, -3.0, -1.5, -0.5, 0.3, 1.0, 3.0, 8.0})
    for (const double slow : {-12.0, -4.0, -1.5, -0.5, 0.1, 0.8, 3.0, 9.0}) {
      if (slow > fast) continue;
      out.push_back(Eigen::Vector2d((fast + slow) / 2, std::pow((fast - slow) / 2, 2)));
    }
  for (const double m : {-8.0, -3.0, -1.0, 1.0, 4.0}) out.push_back(Eigen::Vector2d(m, 0.01));
  return out;
}

/// a, b, c, d of a exp(b x) + c exp(d x).
std::vector<double> publish(const ArgumentScale& s, const VectorXd& beta, const VectorXd& c) {
  const double m = beta[0], d = std::sqrt(std::max(beta[1], least_apart * least_apart));
  const double fast = m + d, slow = m - d;
  double at_fast = c[0], at_slow = c[1];
  if (d >= separate) {
    at_fast *= std::exp(-std::abs(fast));
    at_slow *= std::exp(-std::abs(slow));
  } else {
    const double even = c[0] * std::exp(-std::abs(m)), odd = c[1] * std::exp(-std::abs(m)) / d;
    at_fast = (even + odd) / 2;
    at_slow = (even - odd) / 2;
  }
  const double b = fast / s.half, e = slow / s.half;
  return {at_fast * std::exp(-b * s.centre), b, at_slow * std::exp(-e * s.centre), e};
}

std::vector<std::string> remarks(const ArgumentScale&, const VectorXd& beta, SeparableFit::End) {
  const double d = std::sqrt(std::max(beta[1], 0.0));
  if (d > 0.05) return {};
  return {
      "the two exponentials have become one: their rates differ by less than the points can tell, and large "
      "amplitudes cancel. Use the confluent exponential (a + b x) exp(-c x), which is the same curve with "
      "three "
      "coefficients"};
}

}  // namespace

Family make_exponential_2() {
  Family f;
  f.id = "exponential-2";
  f.title = "exponential(2)";
  f.coefficients = {"a", "b", "c", "d"};
  f.equation = "a * exp(b * x) + c * exp(d * x)";
  f.derivatives = {"exp(b * x)", "a * x * exp(b * x)", "exp(d * x)", "c * x * exp(d * x)"};
  f.value = [](std::span<const double> p, double x) {
    return p[0] * std::exp(p[1] * x) + p[2] * std::exp(p[3] * x);
  };
  f.gradient = [](std::span<const double> p, double x, std::span<double> g) {
    g[0] = std::exp(p[1] * x), g[2] = std::exp(p[3] * x);
    g[1] = p[0] * x * g[0], g[3] = p[2] * x * g[2];
  };
  f.model = [](const ArgumentScale&) {
    SeparableModel m;
    m.linear = 2, m.nonlinear = 2;
    m.basis = basis;
    m.lower = Eigen::Vector2d(-steepest, least_apart * least_apart);
    m.upper = Eigen::Vector2d(steepest, steepest * steepest);
    m.feasible = [](const VectorXd& beta) {
      return std::abs(beta[0]) + std::sqrt(std::max(0.0, beta[1])) <= steepest;
    };
    return m;
  };
  f.starts = starts;
  f.publish = publish;
  f.remarks = remarks;
  return f;
}

}  // namespace fit::families
