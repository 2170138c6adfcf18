// SPDX-License-Identifier: MIT
#include "fit/explain/model/widths.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace fit::explain::model {

using Eigen::Index;
using Eigen::VectorXd;

namespace {

constexpr std::size_t knots = 42;
const double first_log = std::log(WidthLikelihood::hard_deg2);
constexpr double apart = 0.3;  // of the variance's logarithm: the widest beam is 1 deg

double variance_of(std::size_t knot) { return std::exp(first_log + apart * static_cast<double>(knot)); }

/// Between two knots, as a share of their distance.
struct Between {
  std::size_t knot = 0;
  double share = 0;
};
Between place_among_knots(double variance_deg2) {
  const double at = (std::log(std::max(WidthLikelihood::hard_deg2, variance_deg2)) - first_log) / apart;
  const double last = static_cast<double>(knots - 1), within = std::clamp(at, 0.0, last - 1e-9);
  return {static_cast<std::size_t>(within), within - std::floor(within)};
}

double of_all(const std::vector<WidthRow>& rows, std::size_t knot) {
  double sum = 0;
  for (const WidthRow& one : rows) sum += one.width.log_likelihood(variance_of(knot));
  return sum;
}

std::vector<ChannelRows::Row> as_rows(const std::vector<WidthRow>& widths) {
  std::vector<ChannelRows::Row> rows;
  for (const WidthRow& w : widths) rows.push_back({w.at, w.capture, w.width.best_deg2()});
  return rows;
}

}  // namespace

WidthLikelihood::WidthLikelihood(const std::function<double(double width_deg)>& log_likelihood) {
  for (std::size_t k = 0; k < knots; ++k) likelihood_.push_back(log_likelihood(std::sqrt(variance_of(k))));
  for (std::size_t k = 0; k < knots; ++k) {
    const std::size_t below = k == 0 ? 0 : k - 1, above = std::min(knots - 1, k + 1);
    slope_.push_back((likelihood_[above] - likelihood_[below]) / static_cast<double>(above - below));
  }
}

// Hermite's cubics, which have no corners for a scoring step to stumble over.
double WidthLikelihood::log_likelihood(double variance_deg2) const {
  const auto [k, s] = place_among_knots(variance_deg2);
  const double t = 1 - s;
  return t * t * ((1 + 2 * s) * likelihood_[k] + s * slope_[k]) +
         s * s * ((1 + 2 * t) * likelihood_[k + 1] - t * slope_[k + 1]);
}

double WidthLikelihood::score(double variance_deg2) const {
  const auto [k, s] = place_among_knots(variance_deg2);
  const double t = 1 - s, by_knot = 6 * s * t * (likelihood_[k + 1] - likelihood_[k]) +
                                    t * (1 - 3 * s) * slope_[k] + s * (1 - 3 * t) * slope_[k + 1];
  return variance_deg2 < hard_deg2 ? 0 : by_knot / apart / variance_deg2;
}

double WidthLikelihood::information(double variance_deg2) const {
  constexpr double hardly_any = 1e-4;
  if (variance_deg2 < hard_deg2) return hardly_any / (hard_deg2 * hard_deg2);  // less than none is none
  const double v = variance_deg2;
  const std::size_t k = std::clamp<std::size_t>(place_among_knots(v).knot, 1, knots - 3);
  // Over three knots: a profile is a little uneven.
  const double curvature =
      (likelihood_[k] + likelihood_[k + 1] - likelihood_[k - 1] - likelihood_[k + 2]) / 2 / (apart * apart);
  const double slope = score(v) * v, height = std::ranges::max(likelihood_) - log_likelihood(v);
  return std::max({hardly_any, curvature, slope * slope / (2 * std::max(0.0, height) + 1)}) / (v * v);
}

double WidthLikelihood::best_deg2() const {
  const double most = std::ranges::max(likelihood_);
  const auto first = std::ranges::find_if(likelihood_, [&](double l) { return l > most - 0.1; });
  return variance_of(static_cast<std::size_t>(first - likelihood_.begin()));
}

std::vector<WidthLikelihood> in_turn(
    std::size_t captures, const std::function<std::vector<double>(double width_deg)>& log_likelihoods) {
  std::map<double, std::vector<double>> by_width;
  std::vector<WidthLikelihood> all;
  for (std::size_t k = 0; k < captures; ++k)
    all.emplace_back([&](double width_deg) {
      const auto [course, is_new] = by_width.try_emplace(width_deg);
      if (is_new) course->second = log_likelihoods(width_deg);
      return course->second[k];
    });
  return all;
}

double pooled_deg2(const std::vector<WidthRow>& rows) {
  double best = WidthLikelihood::hard_deg2, most = -1e300;
  for (std::size_t k = 0; k < knots; ++k) {
    const double all = of_all(rows, k);
    if (all <= most + 0.1) continue;
    most = all;
    best = variance_of(k);
  }
  return best;
}

double widest_deg2(const std::vector<WidthRow>& rows) {
  constexpr double nearly = 2;
  const double best = pooled_deg2(rows), most = of_all(rows, place_among_knots(best).knot);
  std::size_t widest = knots - 1;
  while (variance_of(widest) > best && of_all(rows, widest) < most - nearly) --widest;
  return std::max(best, variance_of(widest));
}

WidthRows::WidthRows(std::vector<WidthRow> rows)
    : IndependentRows(as_rows(rows)), widths_(std::move(rows)), raised_(fair_place()) {}

/// Where the parabola of all edges promises of a width what their likelihood gives: at the best width it
/// promises far less, as the likelihood falls by the logarithm.
double WidthRows::fair_place() const {
  const auto all = [&](double variance, double (WidthLikelihood::*of_one)(double) const) {
    const VectorXd each =
        VectorXd::NullaryExpr(rows(), [&](Index i) { return (width(i).*of_one)(variance); });
    return each.sum();
  };
  const double hard = WidthLikelihood::hard_deg2, best = pooled_deg2(widths_),
               gain =
                   all(best, &WidthLikelihood::log_likelihood) - all(hard, &WidthLikelihood::log_likelihood);
  double fair = best, off = 1e300;
  constexpr double finer = 0.8;
  for (double v = best; v > hard; v *= finer) {
    const double information = all(v, &WidthLikelihood::information),
                 along = all(v, &WidthLikelihood::score) + information * (v - hard),
                 promised = along * along / information / 2;
    if (std::abs(promised - gain) >= off) continue;
    off = std::abs(promised - gain);
    fair = v;
  }
  return fair;
}

}  // namespace fit::explain::model
