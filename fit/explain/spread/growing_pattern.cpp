// SPDX-License-Identifier: MIT
#include "fit/explain/spread/growing_pattern.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <string>

#include "fit/explain/mean_model.hpp"

namespace fit::explain::spread {
namespace {

/// How a pattern grows: within every capture, or from capture to capture; 1 at its end.
using Growth = double (*)(const Scan& scan, const Scan& last);
double in_captures(const Scan& scan, const Scan&) { return scan.through_capture; }
double over_captures(const Scan& scan, const Scan& last) {
  return (scan.capture + 1.0) / (last.capture + 1.0);
}

/// What scans of every class have in common where that grows: information and score of the classes, of what
/// is news in captures whose own means are not known.
MeanModel::Products growing_classes(const std::vector<Scan>& scans, Numbering number, int modulus,
                                    Growth growth) {
  MeanModel::Products sums{Eigen::MatrixXd::Zero(modulus, modulus), Eigen::VectorXd::Zero(modulus)};
  Eigen::VectorXd weighted(modulus);
  for (std::size_t first = 0, end = 0; first < scans.size(); first = end) {
    weighted.setZero();
    double weight = 0, score = 0;
    for (end = first; end < scans.size() && scans[end].group == scans[first].group; ++end) {
      const Scan& s = scans[end];
      const auto at = static_cast<Eigen::Index>(s.*number % modulus);
      const double size = growth(s, scans.back());
      weighted[at] += s.range_information() * size;
      sums.square(at, at) += s.range_information() * size * size;
      sums.along[at] += s.range_score() * size;
      weight += s.range_information();
      score += s.range_score();
    }
    if (weight <= 0) continue;
    sums.square -= weighted * weighted.transpose() / weight;
    sums.along -= score / weight * weighted;
  }
  return sums;
}

/// Of the differences between classes: what all have in common is a drift, and no pattern of scans.
MeanModel::Products differences_of(const MeanModel::Products& classes) {
  const Eigen::Index modulus = classes.along.size();
  const Eigen::VectorXd drift = Eigen::VectorXd::Ones(modulus), shared = classes.square * drift;
  const double own = drift.dot(shared);
  const Eigen::MatrixXd basis = Eigen::HouseholderQR<Eigen::MatrixXd>(drift).householderQ();
  const auto differences = basis.rightCols(modulus - 1);
  MeanModel::Products rest = classes;
  // From capture to capture there is no drift: every capture's own mean is taken off.
  if (own > 1e-9 * classes.square.trace()) {
    rest.square -= shared * shared.transpose() / own;
    rest.along -= shared * (drift.dot(classes.along) / own);
  }
  return {differences.transpose() * rest.square * differences, differences.transpose() * rest.along};
}

/// That pattern of the size that explains most; `price_of_pattern_size` is paid.
Pattern growing_pattern(const std::vector<Scan>& scans, Numbering number, int modulus, Growth growth) {
  const double inflate = Classes(scans, number, static_cast<std::size_t>(modulus)).scatter(scans);
  MeanModel::Products sums = differences_of(growing_classes(scans, number, modulus, growth));
  sums.square /= inflate;
  sums.along /= inflate;
  Pattern best{0, -1e300, {}};
  for (double scale_mm = least_pattern_mm; scale_mm < most_pattern_mm; scale_mm *= 2) {
    const Prior prior{Eigen::VectorXd::Zero(modulus - 1), Eigen::VectorXd::Constant(modulus - 1, scale_mm)};
    const MeanModel::Fit fit = MeanModel::solve(sums, prior, false);
    const double evidence = fit.evidence - price_of_pattern_size;
    if (evidence > best.evidence) best = {fit.gain, evidence, {}};
  }
  return best;
}

}  // namespace

Pattern growing_pattern(const std::vector<Scan>& scans, double price) {
  struct Way {
    Growth growth;
    const char* says;
  };
  const double price_of_way = std::log(2.0);
  const auto most = static_cast<int>(most_classes(scans));
  Pattern best;
  for (const Way way :
       {Way{in_captures, "within every capture"}, Way{over_captures, "from capture to capture"}})
    for (const Numbering number : numberings)
      for (int modulus = 2; modulus <= most; ++modulus) {
        if (way.growth == over_captures && scans.front().capture == scans.back().capture) continue;
        const Pattern pattern = growing_pattern(scans, number, modulus, way.growth);
        const double evidence = pattern.evidence - price - price_of_way;
        if (evidence > best.evidence)
          best = {pattern.gain, evidence,
                  "the range follows the number of the scan, the same every " + std::to_string(modulus) +
                      " scans, and more and more so " + way.says};
      }
  return best;
}

}  // namespace fit::explain::spread
