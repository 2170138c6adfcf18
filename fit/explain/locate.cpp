// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "fit/explain/explanation.hpp"

namespace fit::explain {
namespace {

constexpr int bins = 30;

struct Span {
  double low = 1e300, high = -1e300;
  [[nodiscard]] double width() const { return (high - low) / bins; }
  [[nodiscard]] int bin(double v) const {
    return std::clamp(static_cast<int>((v - low) / std::max(1e-12, width())), 0, bins - 1);
  }
};

Span span_of(const MeanModel& model, Coordinate coordinate) {
  Span span;
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    const double v = coordinate_at(model, coordinate, i);
    if (!std::isfinite(v)) continue;
    span.low = std::min(span.low, v);
    span.high = std::max(span.high, v);
  }
  return span;
}

/// Neighbouring marked bins form one interval; a gap of one bin is bridged.
std::vector<Located> intervals(const Span& span, const std::vector<bool>& marked, Coordinate coordinate) {
  std::vector<Located> list;
  int last = -10;
  for (int b = 0; b < bins; ++b) {
    if (!marked[static_cast<std::size_t>(b)]) continue;
    const double from = span.low + b * span.width();
    if (b - last <= 2 && !list.empty())
      list.back().to = from + span.width();
    else
      list.push_back({coordinate, from, from + span.width(), Observable::range_mean, 1});
    last = b;
  }
  return list;
}

double two_sided(double z) { return std::max(1e-300, std::erfc(std::abs(z) / std::sqrt(2.0))); }

}  // namespace

std::vector<Located> locate_effect(const MeanModel& model, const Eigen::VectorXd& effect_mm,
                                   Coordinate coordinate) {
  const Span span = span_of(model, coordinate);
  const Eigen::VectorXd left = model.remainder(effect_mm);
  std::vector<double> information(bins, 0.0);
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    const double v = coordinate_at(model, coordinate, i);
    if (!std::isfinite(v)) continue;
    information[static_cast<std::size_t>(span.bin(v))] += std::pow(left[i] / model.sigma_of_mean(i), 2);
  }
  const double most = *std::ranges::max_element(information);
  std::vector<bool> marked(bins, false);
  for (std::size_t b = 0; b < bins; ++b) marked[b] = most > 0 && information[b] >= most / 4;
  auto list = intervals(span, marked, coordinate);
  for (Located& l : list) {
    double sum = 0;
    for (int b = span.bin(l.from + 1e-9); b <= span.bin(l.to - 1e-9); ++b)
      sum += information[static_cast<std::size_t>(b)];
    l.p_value = two_sided(std::sqrt(sum));
  }
  return list;
}

std::vector<Located> locate_residuals(const MeanModel& model, double false_discoveries) {
  const Eigen::VectorXd residual = model.residual();
  struct Test {
    Coordinate coordinate;
    int bin;
    double p;
  };
  std::vector<Test> tests;
  std::vector<std::pair<Coordinate, Span>> spans;
  for (const Coordinate coordinate :
       {Coordinate::beam, Coordinate::stage, Coordinate::range, Coordinate::intensity, Coordinate::incidence,
        Coordinate::time, Coordinate::temperature, Coordinate::stage_rate}) {
    const Span span = span_of(model, coordinate);
    if (!(span.high > span.low)) continue;
    std::vector<double> sum(bins, 0.0), weight(bins, 0.0);
    for (Eigen::Index i = 0; i < model.rows(); ++i) {
      const double v = coordinate_at(model, coordinate, i);
      if (!std::isfinite(v)) continue;
      const auto b = static_cast<std::size_t>(span.bin(v));
      const double w = 1 / (model.sigma_of_mean(i) * model.sigma_of_mean(i));
      sum[b] += w * residual[i];
      weight[b] += w;
    }
    spans.emplace_back(coordinate, span);
    for (int b = 0; b < bins; ++b) {
      const auto k = static_cast<std::size_t>(b);
      if (weight[k] > 0) tests.push_back({coordinate, b, two_sided(sum[k] / std::sqrt(weight[k]))});
    }
  }
  // Benjamini and Hochberg (1995): the largest p below its line, and all smaller ones.
  std::vector<double> sorted;
  for (const Test& t : tests) sorted.push_back(t.p);
  std::ranges::sort(sorted);
  double threshold = 0;
  for (std::size_t i = 0; i < sorted.size(); ++i)
    if (sorted[i] <= false_discoveries * static_cast<double>(i + 1) / static_cast<double>(sorted.size()))
      threshold = sorted[i];
  std::vector<Located> list;
  for (const auto& [coordinate, span] : spans) {
    std::vector<bool> marked(bins, false);
    std::vector<double> p(bins, 1.0);
    for (const Test& t : tests) {
      if (t.coordinate != coordinate) continue;
      marked[static_cast<std::size_t>(t.bin)] = t.p <= threshold;
      p[static_cast<std::size_t>(t.bin)] = t.p;
    }
    for (Located l : intervals(span, marked, coordinate)) {
      for (int b = span.bin(l.from + 1e-9); b <= span.bin(l.to - 1e-9); ++b)
        l.p_value = std::min(l.p_value, p[static_cast<std::size_t>(b)]);
      list.push_back(l);
    }
  }
  return list;
}

Curve curve_of(const MeanModel& before, const MeanModel& after, Coordinate coordinate) {
  Curve curve;
  curve.coordinate = coordinate;
  const Span span = span_of(before, coordinate);
  if (!(span.high > span.low)) return curve;
  const Eigen::VectorXd first = before.residual(), last = after.residual();
  std::vector<double> sum(bins, 0.0), less(bins, 0.0), weight(bins, 0.0);
  for (Eigen::Index i = 0; i < std::min(before.rows(), after.rows()); ++i) {
    const double v = coordinate_at(before, coordinate, i);
    if (!std::isfinite(v)) continue;
    const auto b = static_cast<std::size_t>(span.bin(v));
    const double w = 1 / (before.sigma_of_mean(i) * before.sigma_of_mean(i));
    sum[b] += w * first[i];
    less[b] += w * last[i];
    weight[b] += w;
  }
  for (std::size_t b = 0; b < bins; ++b) {
    if (weight[b] <= 0) continue;
    curve.at.push_back(span.low + (static_cast<double>(b) + 0.5) * span.width());
    curve.before_mm.push_back(sum[b] / weight[b]);
    curve.after_mm.push_back(less[b] / weight[b]);
    curve.sigma_mm.push_back(1 / std::sqrt(weight[b]));
  }
  return curve;
}

}  // namespace fit::explain
