// SPDX-License-Identifier: MIT
#include "fit/explain/model/rough_surfaces.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include "fit/explain/numbers.hpp"
#include "fit/numeric/straight_line.hpp"

namespace fit::explain::model {
namespace {

using Eigen::Index;

/// Lengths of stretches, each half as long as the next. Longer waves are cosines of the whole target; a spot
/// evens out shorter ones.
constexpr std::array lengths_mm{30.0, 60.0, 120.0, 240.0, 480.0};

/// What a stretch adds by itself, where two places a metre apart differ by one. Means of neighbouring
/// stretches of a random walk differ by 2/3 of the variance that it walks along one: with what the parts of
/// both add, by 8/3 of a stretch's own.
double own_sigma(double length_mm) { return std::sqrt(length_mm / 1000 / 4); }

}  // namespace

std::vector<RoughSurfaces::Level> RoughSurfaces::tree_of(const std::vector<Place>& places) {
  std::vector<Level> tree;
  for (const double length_mm : lengths_mm) {
    std::map<std::pair<int, int>, std::vector<Index>> parts;
    for (std::size_t i = 0; i < places.size(); ++i)
      parts[{places[i].target, static_cast<int>(std::floor(places[i].along_mm / length_mm))}].push_back(
          static_cast<Index>(i));
    Level& level = tree.emplace_back(length_mm);
    for (auto& [part, rows] : parts) level.stretches.push_back(std::move(rows));
  }
  return tree;
}

RoughSurfaces::RoughSurfaces(const std::vector<Place>& places, const std::vector<Level>& tree, Steps steps_mm)
    : steps_mm_(std::move(steps_mm)) {
  for (const auto& [length_mm, stretches] : tree) {
    Eigen::MatrixXd z(static_cast<Index>(places.size()), 1);
    for (Index i = 0; i < z.rows(); ++i) {
      const Place& at = places[static_cast<std::size_t>(i)];
      z(i, 0) = own_sigma(length_mm) * steps_mm_.at(at.target) * at.slope;
    }
    whiten(z);
    std::vector<Stretch> added;
    for (const std::vector<Index>& rows : stretches) {
      const std::size_t first = rows_.size();
      double square = 0;
      for (const Index row : rows) {
        rows_.push_back(row);
        z_.push_back(z(row, 0));
        square += z(row, 0) * z(row, 0);
      }
      constexpr double hardly = 0.01;  // of a row's own noise
      if (square < hardly) {
        rows_.resize(first);
        z_.resize(first);
        continue;
      }
      added.push_back({first, rows_.size(), (1 - 1 / std::sqrt(1 + square)) / square});
      log_determinants_[places[static_cast<std::size_t>(rows.front())].target] += std::log(1 + square);
    }
    stretches_.insert(stretches_.end(), added.begin(), added.end());
  }
}

double RoughSurfaces::log_determinant() const {
  double sum = 0;
  for (const auto& [target, own] : log_determinants_) sum += own;
  return sum;
}

double RoughSurfaces::log_determinant_of(int target) const {
  const auto own = log_determinants_.find(target);
  return own == log_determinants_.end() ? 0 : own->second;
}

double RoughSurfaces::variance_mm2(int target) const {
  double shares = 0;
  for (const double length_mm : lengths_mm) shares += std::pow(own_sigma(length_mm), 2);
  return shares * std::pow(steps_mm_.at(target), 2);
}

void RoughSurfaces::whiten(Eigen::Ref<Eigen::VectorXd> column) const {
  for (const Stretch& s : stretches_) {
    double sum = 0;
    for (std::size_t k = s.first; k < s.last; ++k) sum += z_[k] * column[rows_[k]];
    sum *= s.shrink;
    for (std::size_t k = s.first; k < s.last; ++k) column[rows_[k]] -= sum * z_[k];
  }
}

void RoughSurfaces::whiten(Eigen::MatrixXd& columns) const {
  for (Index k = 0; k < columns.cols(); ++k) whiten(columns.col(k));
}

namespace {

/// Less the line, in range over the place, along every target in every group.
Eigen::VectorXd without_lines(const std::vector<RoughSurfaces::Place>& places,
                              const Eigen::VectorXd& residual) {
  std::map<std::pair<int, int>, StraightLine> lines;
  const auto line_of = [&](const RoughSurfaces::Place& at) -> StraightLine& {
    return lines[{at.group, at.target}];
  };
  Eigen::VectorXd left = residual;
  for (std::size_t i = 0; i < places.size(); ++i)
    line_of(places[i]).add(places[i].along_mm, residual[static_cast<Index>(i)] / places[i].weight,
                           places[i].weight * places[i].weight);
  for (std::size_t i = 0; i < places.size(); ++i) {
    const StraightLine& line = line_of(places[i]);
    const double at = line.spread() > 0 ? line.at(places[i].along_mm) : line.mean();
    left[static_cast<Index>(i)] -= places[i].weight * at;
  }
  return left;
}

}  // namespace

LikeliestSurfaces likeliest_surfaces(const std::vector<RoughSurfaces::Place>& places,
                                     const Eigen::VectorXd& residual) {
  const std::vector<RoughSurfaces::Level> tree = RoughSurfaces::tree_of(places);
  const Eigen::VectorXd left = without_lines(places, residual);
  const auto off = [](double step_mm, double usual_mm) {
    return 0.5 * std::pow(std::log(step_mm / usual_mm) / std::log(numbers::rough_within), 2);
  };
  constexpr double most = numbers::rough_within * numbers::rough_within * numbers::rough_within;
  std::vector<double> tried_mm;
  std::map<int, std::vector<double>> log_likelihoods;  // of every target, of what was tried
  std::vector<double> log_posteriors;                  // of all targets alike
  for (double step_mm = numbers::rough_mm / most; step_mm < 1.1 * most * numbers::rough_mm;
       step_mm *= std::sqrt(2.0)) {
    RoughSurfaces::Steps alike;
    for (const RoughSurfaces::Place& at : places) alike[at.target] = step_mm;
    const RoughSurfaces surfaces(places, tree, alike);
    Eigen::MatrixXd white = left;
    surfaces.whiten(white);
    for (const auto& [target, step] : alike)
      log_likelihoods[target].push_back(-0.5 * surfaces.log_determinant_of(target));
    for (std::size_t i = 0; i < places.size(); ++i)
      log_likelihoods[places[i].target].back() -= 0.5 * std::pow(white(static_cast<Index>(i), 0), 2);
    log_posteriors.push_back(-off(step_mm, numbers::rough_mm));
    for (const auto& [target, logs] : log_likelihoods) log_posteriors.back() += logs.back();
    tried_mm.push_back(step_mm);
  }
  const auto likeliest = [](const std::vector<double>& logs) {
    return static_cast<std::size_t>(std::ranges::max_element(logs) - logs.begin());
  };
  const std::size_t common = likeliest(log_posteriors);
  std::size_t usual = 0;
  while (tried_mm[usual] < numbers::rough_mm) ++usual;
  // A size that all share strains the prior by no more than a form costs; one of a target alone is a form.
  const bool strained = tried_mm[common] > numbers::rough_mm &&
                        off(tried_mm[common], numbers::rough_mm) > -std::log(numbers::forms_expected);
  const double penalty = std::log(static_cast<double>(log_likelihoods.size()) / numbers::forms_expected) +
                         std::log(numbers::named_at / (1 - numbers::named_at));
  RoughSurfaces::Steps steps_mm;
  std::map<int, double> odd;
  for (const auto& [target, logs] : log_likelihoods) {
    std::size_t others = common, best = common;
    if (log_likelihoods.size() > 1) {
      std::vector<double> of_others = log_posteriors;
      for (std::size_t k = 0; k < logs.size(); ++k) of_others[k] -= logs[k];
      others = std::max(usual, likeliest(of_others));  // what any board may have
    }
    double gain = numbers::fits_as_well;  // what a size of its own costs
    for (std::size_t k = 0; k < logs.size(); ++k)
      if (const double own = logs[k] - logs[others] - off(tried_mm[k], tried_mm[others]); own > gain) {
        best = k;
        gain = own;
      }
    steps_mm[target] = tried_mm[best];
    if (best > others && gain > penalty)
      odd[target] = gain;
    else if (best == common && strained)
      odd[target] = logs[common] - logs[usual];
  }
  return {{places, tree, std::move(steps_mm)}, std::move(odd)};
}

}  // namespace fit::explain::model
