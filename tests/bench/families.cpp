// SPDX-License-Identifier: MIT
// Fitting all families with non-linear parameters, all starts: separable least squares beside NLopt (SLSQP
// with analytic gradients, its best here) on all parameters at once from the same starts, where it is even
// given the exact linear part to begin with. The rival's minimum is checked: ours may never be worse.
#include <benchmark/benchmark.h>
#include <nlopt.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "fit/range/family.hpp"

namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// The published distance error (source A, equation 15) with noise.
std::vector<fit::CurvePoint> data(int n) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  std::vector<fit::CurvePoint> points;
  const double w = -1.341e-4;
  for (int i = 0; i < n; ++i) {
    const double mm = 200 + 9600.0 * i / (n - 1);
    const double error = 919.7 - 966.6 * std::cos(w * mm) + 52.28 * std::cos(2 * w * mm) +
                         777 * std::sin(w * mm) - 326.3 * std::sin(2 * w * mm);
    points.push_back({mm, error + normal(random), 1});
  }
  return points;
}

std::vector<const fit::Family*> families() {
  std::vector<const fit::Family*> out;
  for (const fit::Family& family : fit::all_families())
    if (family.starts) out.push_back(&family);
  return out;
}

/// NLopt on (beta, c) at once.
class AllAtOnce {
 public:
  AllAtOnce(const fit::Family& family, const std::vector<fit::CurvePoint>& points)
      : t_(points.size()), y_(points.size()) {
    const fit::ArgumentScale scale{(points.front().x + points.back().x) / 2,
                                   (points.back().x - points.front().x) / 2};
    model_ = family.model(scale);
    starts_ = family.starts(scale);
    for (std::size_t i = 0; i < points.size(); ++i) {
      t_[static_cast<Eigen::Index>(i)] = scale.to_scaled(points[i].x);
      y_[static_cast<Eigen::Index>(i)] = points[i].y;
    }
    phi_.resize(t_.size(), model_.linear);
    dphi_.assign(static_cast<std::size_t>(model_.nonlinear), phi_);
  }

  double best() {
    double least = std::numeric_limits<double>::infinity();
    for (const VectorXd& start : starts_)
      if (!model_.feasible || model_.feasible(start)) least = std::min(least, from(start));
    return least;
  }

 private:
  double from(const VectorXd& start) {
    const int b = model_.nonlinear, n = b + model_.linear;
    VectorXd x(n);
    x.head(b) = start;
    model_.basis(t_, start, phi_, nullptr);
    x.tail(model_.linear) = phi_.colPivHouseholderQr().solve(y_);
    scale_ = std::max(1e-9, (y_ - phi_ * x.tail(model_.linear)).squaredNorm());
    nlopt_opt opt = nlopt_create(NLOPT_LD_SLSQP, static_cast<unsigned>(n));
    VectorXd low = VectorXd::Constant(n, -HUGE_VAL), high = VectorXd::Constant(n, HUGE_VAL);
    low.head(b) = model_.lower, high.head(b) = model_.upper;
    nlopt_set_lower_bounds(opt, low.data());
    nlopt_set_upper_bounds(opt, high.data());
    nlopt_set_min_objective(
        opt,
        [](unsigned, const double* at, double* g, void* self) {
          return static_cast<AllAtOnce*>(self)->cost(at, g);
        },
        this);
    nlopt_set_ftol_rel(opt, 1e-12);
    nlopt_set_xtol_rel(opt, 1e-9);
    nlopt_set_maxeval(opt, 1000);
    double cost = 0;
    nlopt_optimize(opt, x.data(), &cost);
    nlopt_destroy(opt);
    return cost > 0 && std::isfinite(cost) ? cost * scale_ : std::numeric_limits<double>::infinity();
  }

  double cost(const double* at, double* gradient) {
    const int b = model_.nonlinear;
    const Eigen::Map<const VectorXd> beta(at, b), c(at + b, model_.linear);
    if (model_.feasible && !model_.feasible(beta)) {
      if (gradient) std::fill_n(gradient, b + model_.linear, 0.0);
      return 1e6;
    }
    model_.basis(t_, beta, phi_, gradient ? &dphi_ : nullptr);
    const VectorXd residual = y_ - phi_ * c;
    if (gradient) {
      for (int k = 0; k < b; ++k)
        gradient[k] = -2 / scale_ * residual.dot(dphi_[static_cast<std::size_t>(k)] * c);
      Eigen::Map<VectorXd>(gradient + b, model_.linear) = -2 / scale_ * phi_.transpose() * residual;
    }
    const double value = residual.squaredNorm() / scale_;
    return std::isfinite(value) ? value : 1e6;
  }

  fit::SeparableModel model_;
  std::vector<VectorXd> starts_;
  VectorXd t_, y_;
  MatrixXd phi_;
  std::vector<MatrixXd> dphi_;
  double scale_ = 1;
};

void ours(benchmark::State& state, int n) {
  const auto points = data(n);
  fit::FamilyOptions options;
  options.held_out = false;
  std::map<std::string, double> found;
  for (auto _ : state)
    for (const fit::Family* family : families())
      found[family->id] = fit::fit_family(*family, points, options).chi2;
  for (const fit::Family* family : families()) {
    const double rival = AllAtOnce(*family, points).best();
    if (found[family->id] > rival * (1 + 1e-6))
      state.SkipWithError((family->id + ": the rival found a better minimum").c_str());
  }
  state.counters["goal"] = 20;
}

void nlopt(benchmark::State& state, int n) {
  const auto points = data(n);
  for (auto _ : state)
    for (const fit::Family* family : families()) benchmark::DoNotOptimize(AllAtOnce(*family, points).best());
}

}  // namespace

BENCHMARK_CAPTURE(ours, 97, 97)->Name("fit families, 97 points/ours")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(nlopt, 97, 97)
    ->Name("fit families, 97 points/rival:nlopt-all-parameters")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(ours, 10000, 10000)->Name("fit families, 10000 points/ours")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(nlopt, 10000, 10000)
    ->Name("fit families, 10000 points/rival:nlopt-all-parameters")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_MAIN();
