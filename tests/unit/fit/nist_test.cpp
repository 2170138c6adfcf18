// SPDX-License-Identifier: MIT
// The separable solver against certified values and standard deviations, from both published starts of each
// set.
#include <catch2/catch.hpp>
#include <cmath>
#include <numeric>

#include "fit/numeric/separable.hpp"
#include "nist_data.hpp"

namespace nist_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

struct Certified {
  const char* name;
  std::vector<double> x, y;
  fit::SeparableModel model;
  /// The published parameters of a fit, and the published curve.
  std::function<VectorXd(const VectorXd& beta, const VectorXd& c)> parameters;
  std::function<double(const VectorXd& b, double x)> curve;
  std::vector<VectorXd> starts;  ///< Of the non-linear parameters.
  std::vector<double> values, deviations;
  double sum_of_squares;
};

VectorXd vec(std::initializer_list<double> values) {
  VectorXd out(static_cast<Eigen::Index>(values.size()));
  std::copy(values.begin(), values.end(), out.begin());
  return out;
}

fit::SeparableModel saturation() {
  fit::SeparableModel m;
  m.linear = 1, m.nonlinear = 1;
  m.basis = [](const VectorXd& x, const VectorXd& b, MatrixXd& phi, std::vector<MatrixXd>* d) {
    phi.col(0) = 1 - (-b[0] * x.array()).exp();
    if (d) (*d)[0].col(0) = x.array() * (-b[0] * x.array()).exp();
  };
  return m;
}

fit::SeparableModel cubic_over_cubic() {
  fit::SeparableModel m;
  m.linear = 4, m.nonlinear = 3;
  m.basis = [](const VectorXd& x, const VectorXd& b, MatrixXd& phi, std::vector<MatrixXd>* d) {
    const Eigen::ArrayXd t = x.array(), low = 1 + t * (b[0] + t * (b[1] + t * b[2]));
    phi.col(0) = 1 / low;
    for (int j = 1; j < 4; ++j) phi.col(j) = phi.col(j - 1).array() * t;
    if (!d) return;
    Eigen::ArrayXd power = t;
    for (int k = 0; k < 3; ++k, power *= t)
      for (int j = 0; j < 4; ++j)
        (*d)[static_cast<std::size_t>(k)].col(j) = -phi.col(j).array() * power / low;
  };
  return m;
}

double cubic_curve(const VectorXd& b, double x) {
  return (b[0] + x * (b[1] + x * (b[2] + x * b[3]))) / (1 + x * (b[4] + x * (b[5] + x * b[6])));
}

VectorXd linear_then_rest(const VectorXd& beta, const VectorXd& c) {
  VectorXd out(c.size() + beta.size());
  out << c, beta;
  return out;
}

double saturation_curve(const VectorXd& b, double x) { return b[0] * (1 - std::exp(-b[1] * x)); }

fit::SeparableModel mgh09_model() {
  fit::SeparableModel m;
  m.linear = 2, m.nonlinear = 2;
  m.basis = [](const VectorXd& x, const VectorXd& b, MatrixXd& phi, std::vector<MatrixXd>* d) {
    const Eigen::ArrayXd t = x.array(), low = t * t + t * b[0] + b[1];
    phi.col(0) = t * t / low;
    phi.col(1) = t / low;
    if (!d) return;
    for (int j = 0; j < 2; ++j) {
      (*d)[0].col(j) = -phi.col(j).array() * t / low;
      (*d)[1].col(j) = -phi.col(j).array() / low;
    }
  };
  return m;
}

fit::SeparableModel gauss3_model() {
  fit::SeparableModel m;
  m.linear = 3, m.nonlinear = 5;
  m.basis = [](const VectorXd& x, const VectorXd& b, MatrixXd& phi, std::vector<MatrixXd>* d) {
    const Eigen::ArrayXd t = x.array();
    phi.col(0) = (-b[0] * t).exp();
    for (int g = 0; g < 2; ++g) phi.col(1 + g) = (-((t - b[1 + 2 * g]) / b[2 + 2 * g]).square()).exp();
    if (!d) return;
    for (MatrixXd& part : *d) part.setZero();
    (*d)[0].col(0) = -t * phi.col(0).array();
    for (int g = 0; g < 2; ++g) {
      const Eigen::ArrayXd off = t - b[1 + 2 * g];
      const double width = b[2 + 2 * g];
      const auto at = static_cast<std::size_t>(1 + 2 * g);
      (*d)[at].col(1 + g) = phi.col(1 + g).array() * 2 * off / (width * width);
      (*d)[at + 1].col(1 + g) = phi.col(1 + g).array() * 2 * off.square() / (width * width * width);
    }
  };
  return m;
}

std::vector<Certified> sets() {
  std::vector<Certified> out;
  out.push_back({"Misra1a",
                 nist::misra1a_x,
                 nist::misra1a_y,
                 saturation(),
                 linear_then_rest,
                 saturation_curve,
                 {vec({0.0001}), vec({0.0005})},
                 {2.3894212918E+02, 5.5015643181E-04},
                 {2.7070075241E+00, 7.2668688436E-06},
                 1.2455138894E-01});
  out.push_back({"BoxBOD",
                 nist::boxbod_x,
                 nist::boxbod_y,
                 saturation(),
                 linear_then_rest,
                 saturation_curve,
                 {vec({1}), vec({0.75})},
                 {2.1380940889E+02, 5.4723748542E-01},
                 {1.2354515176E+01, 1.0455993237E-01},
                 1.1680088766E+03});
  out.push_back({"Thurber",
                 nist::thurber_x,
                 nist::thurber_y,
                 cubic_over_cubic(),
                 linear_then_rest,
                 cubic_curve,
                 {vec({0.7, 0.3, 0.03}), vec({1, 0.4, 0.05})},
                 {1.2881396800E+03, 1.4910792535E+03, 5.8323836877E+02, 7.5416644291E+01, 9.6629502864E-01,
                  3.9797285797E-01, 4.9727297349E-02},
                 {4.6647963344E+00, 3.9571156086E+01, 2.8698696102E+01, 5.5675370270E+00, 3.1333340687E-02,
                  1.4984928198E-02, 6.5842344623E-03},
                 5.6427082397E+03});
  out.push_back({"Hahn1",
                 nist::hahn1_x,
                 nist::hahn1_y,
                 cubic_over_cubic(),
                 linear_then_rest,
                 cubic_curve,
                 {vec({-0.05, 0.001, -0.000001}), vec({-0.005, 0.0001, -0.0000001})},
                 {1.0776351733E+00, -1.2269296921E-01, 4.0863750610E-03, -1.4262662514E-06, -5.7609940901E-03,
                  2.4053735503E-04, -1.2314450199E-07},
                 {1.7070154742E-01, 1.2000289189E-02, 2.2508314937E-04, 2.7578037666E-07, 2.4712888219E-04,
                  1.0449373768E-05, 1.3027335327E-08},
                 1.5324382854E+00});
  out.push_back(
      {"MGH09",
       nist::mgh09_x,
       nist::mgh09_y,
       mgh09_model(),
       [](const VectorXd& beta, const VectorXd& c) {
         return vec({c[0], c[1] / c[0], beta[0], beta[1]});
       },
       [](const VectorXd& b, double x) { return b[0] * (x * x + x * b[1]) / (x * x + x * b[2] + b[3]); },
       {vec({41.5, 39}), vec({0.415, 0.39})},
       {1.9280693458E-01, 1.9128232873E-01, 1.2305650693E-01, 1.3606233068E-01},
       {1.1435312227E-02, 1.9633220911E-01, 8.0842031232E-02, 9.0025542308E-02},
       3.0750560385E-04});
  std::vector<double> x(250);
  std::iota(x.begin(), x.end(), 1.0);
  out.push_back({"Gauss3",
                 x,
                 nist::gauss3_y,
                 gauss3_model(),
                 [](const VectorXd& b, const VectorXd& c) {
                   return vec({c[0], b[0], c[1], b[1], b[2], c[2], b[3], b[4]});
                 },
                 [](const VectorXd& b, double t) {
                   return b[0] * std::exp(-b[1] * t) + b[2] * std::exp(-std::pow((t - b[3]) / b[4], 2)) +
                          b[5] * std::exp(-std::pow((t - b[6]) / b[7], 2));
                 },
                 {vec({0.009, 113, 20, 140, 20}), vec({0.0096, 110, 25, 139, 25})},
                 {9.8940368970E+01, 1.0945879335E-02, 1.0069553078E+02, 1.1163619459E+02, 2.3300500029E+01,
                  7.3705031418E+01, 1.4776164251E+02, 1.9668221230E+01},
                 {5.3005192833E-01, 1.2554058911E-04, 8.1256587317E-01, 3.5317859757E-01, 3.6584783023E-01,
                  1.2091239082E+00, 4.0488183351E-01, 3.7806634336E-01},
                 1.2444846360E+03});
  return out;
}

/// Of the published form, by central differences.
MatrixXd jacobian_of(const Certified& set, const VectorXd& b) {
  MatrixXd out(static_cast<Eigen::Index>(set.x.size()), b.size());
  for (Eigen::Index j = 0; j < b.size(); ++j) {
    VectorXd above = b, below = b;
    const double h = 1e-5 * std::abs(b[j]);
    above[j] += h, below[j] -= h;
    for (Eigen::Index i = 0; i < out.rows(); ++i) {
      const double x = set.x[static_cast<std::size_t>(i)];
      out(i, j) = (set.curve(above, x) - set.curve(below, x)) / (2 * h);
    }
  }
  return out;
}

}  // namespace

TEST_CASE("NIST's certified values and standard deviations are reproduced from both starts") {
  for (const Certified& set : sets()) {
    fit::WeightedPoints points;
    points.x = Eigen::Map<const VectorXd>(set.x.data(), static_cast<Eigen::Index>(set.x.size()));
    points.y = Eigen::Map<const VectorXd>(set.y.data(), static_cast<Eigen::Index>(set.y.size()));
    points.weight = VectorXd::Ones(points.x.size());
    REQUIRE(points.x.size() == points.y.size());
    for (const VectorXd& start : set.starts) {
      const auto fit = fit::solve_separable(set.model, points, start, 2000);
      INFO(set.name << " from " << start[0] << " in " << fit.iterations << " steps");
      CHECK(fit.end == fit::SeparableFit::End::converged);
      CHECK(fit.chi2 == Approx(set.sum_of_squares).epsilon(1e-9));
      const VectorXd b = set.parameters(fit.beta, fit.c);
      const double freedom = static_cast<double>(set.x.size() - set.values.size());
      const MatrixXd factor =
          fit::covariance_factor(jacobian_of(set, b)).factor * std::sqrt(fit.chi2 / freedom);
      for (std::size_t j = 0; j < set.values.size(); ++j) {
        INFO("b" << j + 1);
        CHECK(b[static_cast<Eigen::Index>(j)] == Approx(set.values[j]).epsilon(1e-7));
        CHECK(factor.row(static_cast<Eigen::Index>(j)).norm() == Approx(set.deviations[j]).epsilon(1e-5));
      }
    }
  }
}

}  // namespace nist_test
