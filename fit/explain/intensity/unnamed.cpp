// SPDX-License-Identifier: MIT
#include "fit/explain/intensity/unnamed.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>

#include "fit/explain/odds.hpp"

namespace fit::explain::intensity {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t targets_at_most = 12;
constexpr int rows_of_target = 40;
constexpr std::array lengths{finest, 0.15, 0.4};
constexpr std::array sizes{0.001, 0.003, 0.01, 0.03, 0.1, 0.3};  // of the logarithm of intensity
constexpr double bin_mm = 20;
constexpr std::array<std::size_t, 5> widths{3, 6, 12, 24, 48};  // of patches, bins

bool takes_few_values(const VectorXd& x) {
  std::vector<double> distinct(x.data(), x.data() + x.size());
  std::erase_if(distinct, [](double v) { return !std::isfinite(v); });
  std::ranges::sort(distinct);
  distinct.erase(std::unique(distinct.begin(), distinct.end()), distinct.end());
  return distinct.size() <= 4;
}

/// What is left of the intensity of a target, by bins along it.
struct AlongTarget {
  double low_mm = 1e300, high_mm = -1e300;
  std::vector<double> weight, along;  ///< Sums over all bins before each: of weights, and times residuals.
};

std::map<int, AlongTarget> along_targets(const Readings& readings, const VectorXd& residual) {
  std::map<int, AlongTarget> targets;
  for (Index i = 0; i < readings.count(); ++i) {
    const Circumstances& at = readings.cell(i).at;
    AlongTarget& sums = targets[at.target];
    sums.low_mm = std::min(sums.low_mm, at.along_mm);
    sums.high_mm = std::max(sums.high_mm, at.along_mm);
  }
  for (auto& [target, sums] : targets) {
    const auto bins = static_cast<std::size_t>((sums.high_mm - sums.low_mm) / bin_mm) + 1;
    sums.weight.assign(bins + 1, 0);
    sums.along.assign(bins + 1, 0);
  }
  for (Index i = 0; i < readings.count(); ++i) {
    const Circumstances& at = readings.cell(i).at;
    AlongTarget& sums = targets.at(at.target);
    const auto bin = static_cast<std::size_t>((at.along_mm - sums.low_mm) / bin_mm) + 1;
    const double w = 1 / (readings.row(i).sigma * readings.row(i).sigma);
    sums.weight[bin] += w;
    sums.along[bin] += w * residual[i];
  }
  for (auto& [target, sums] : targets) {
    std::partial_sum(sums.weight.begin(), sums.weight.end(), sums.weight.begin());
    std::partial_sum(sums.along.begin(), sums.along.end(), sums.along.begin());
  }
  return targets;
}

std::optional<Suspicion::Patch> best_patch(const AlongTarget& sums) {
  std::optional<Suspicion::Patch> patch;
  double best = 0, looked_at = 0;
  for (const std::size_t width : widths)
    for (std::size_t first = 0; 2 * width < sums.weight.size() && first + width < sums.weight.size();
         ++first) {
      const double weight = sums.weight[first + width] - sums.weight[first],
                   along = sums.along[first + width] - sums.along[first];
      ++looked_at;
      if (!(weight > 0) || along * along <= best * weight) continue;
      best = along * along / weight;
      const double from = sums.low_mm + static_cast<double>(first) * bin_mm;
      patch = {from, from + static_cast<double>(width) * bin_mm, 0};
    }
  if (patch) patch->price = std::log(looked_at / 3);  // neighbours hardly differ
  return patch;
}

double price_of(const Suspicion& s) {
  return (s.other_law() ? odds::price_of_mechanism : odds::price_of_unknown) + std::log(sizes.size()) +
         (s.patch ? s.patch->price : 0);
}

}  // namespace

std::vector<Suspicion> smooth_functions(const Readings& readings) {
  std::vector<Suspicion> list;
  const auto offer = [&](Coordinate coordinate, int about) {
    for (const double length : lengths) {
      Suspicion s;
      s.coordinate = coordinate;
      s.about = about;
      s.length = length;
      list.push_back(s);
    }
  };
  for (const Coordinate c : {Coordinate::beam, Coordinate::stage, Coordinate::range, Coordinate::intensity,
                             Coordinate::incidence, Coordinate::time})
    if (!takes_few_values(readings.coordinate(c))) offer(c, -1);
  std::vector<int> seen(readings.reduced.bench.targets.size(), 0);
  for (Index i = 0; i < readings.count(); ++i) ++seen[static_cast<std::size_t>(readings.cell(i).at.target)];
  for (std::size_t t = 0; t < seen.size() && t < targets_at_most; ++t)
    if (seen[t] > rows_of_target) offer(Coordinate::target, static_cast<int>(t));
  return list;
}

std::vector<Suspicion> patches(const Readings& readings, const Model& model) {
  std::vector<Suspicion> list;
  for (const auto& [target, sums] : along_targets(readings, model.residual())) {
    Suspicion s;
    s.coordinate = Coordinate::target;
    s.about = target;
    s.patch = best_patch(sums);
    if (s.patch) list.push_back(s);
  }
  return list;
}

void find_size(const Readings& readings, const Model& model, Suspicion& s) {
  const MatrixXd columns = columns_of(readings, s);
  if (columns.cols() == 0) return;
  const MeanModel::Products products = model.products(columns);
  const double price = price_of(s);
  for (const double size : sizes) {
    const Prior prior{VectorXd::Zero(columns.cols()), VectorXd::Constant(columns.cols(), size)};
    const MeanModel::Fit fit = MeanModel::solve(products, prior, false);
    if (fit.evidence - price <= s.evidence) continue;
    s.evidence = fit.evidence - price;
    s.gain = fit.gain;
    s.size = size;
  }
}

VectorXd function_of(const Readings& readings, const std::vector<Suspicion>& accepted, const Suspicion& s) {
  std::vector<Suspicion> others = accepted;
  std::erase_if(others, [&](const Suspicion& o) { return !o.mechanism && o.same_as(s); });
  const MatrixXd columns = columns_of(readings, s);
  const Prior prior{VectorXd::Zero(columns.cols()), VectorXd::Constant(columns.cols(), s.size)};
  return columns * MeanModel::solve(model_of(readings, others).products(columns), prior, false).value;
}

}  // namespace fit::explain::intensity
