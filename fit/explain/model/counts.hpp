// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>

#include "fit/explain/model/channel.hpp"
#include "fit/explain/numbers.hpp"

namespace fit::explain::model {

/// Samples of n to which something happened: binomial, the probability 1 - exp(-eta), so that hazards of
/// independent causes add.
class Counts : public IndependentRows {
 public:
  using IndependentRows::IndependentRows;
  [[nodiscard]] double seen(Eigen::Index row) const override { return of(row).y / of(row).n; }
  [[nodiscard]] double offset(Eigen::Index) const override { return numbers::least_hazard; }

  [[nodiscard]] Eigen::VectorXd expansion_for_new_terms(const Eigen::VectorXd& eta) const override {
    return eta.cwiseMax(std::max(numbers::least_hazard, on_the_whole()));
  }

  [[nodiscard]] Eigen::VectorXd feasible(Eigen::VectorXd eta) const override {
    return eta.cwiseMax(numbers::least_hazard);
  }
  /// Where nothing happened, fewer than one event in all of a row's samples cannot be told from none; but no
  /// more is expected than happens on the whole, or steps are too long. Where more happened than expected,
  /// the likelihood bends more than on average, near its best by as much as is seen over what is expected.
  [[nodiscard]] Eigen::VectorXd expansion_for_steps(Eigen::VectorXd eta) const override {
    constexpr double most_bent = 16;
    const double whole = std::max(numbers::least_hazard, on_the_whole());
    for (Eigen::Index i = 0; i < rows(); ++i) {
      const double h = hazard_of(eta[i]), seen = of(i).y / of(i).n;
      eta[i] = of(i).y == 0 ? std::max(eta[i], std::min(whole, 1 / of(i).n))
               : h < seen   ? h * std::max(h / seen, 1 / most_bent)
                            : h;
    }
    return eta;
  }
  [[nodiscard]] Eigen::VectorXd expansion_for_evidence(Eigen::VectorXd eta) const override {
    for (Eigen::Index i = 0; i < rows(); ++i) {
      if (of(i).y == 0) {
        eta[i] = std::max(eta[i], 1 / of(i).n);
        continue;
      }
      const double h = hazard_of(eta[i]), seen = of(i).y / of(i).n;
      eta[i] = h < seen ? std::max(1e-12, h * h / seen) : h;
    }
    return eta;
  }
  /// Of what never happened, the likelihood is an exponential: next to no curvature.
  [[nodiscard]] Eigen::VectorXd expansion_for_last_steps(Eigen::VectorXd eta) const override {
    constexpr double all_but_flat = 1;
    for (Eigen::Index i = 0; i < rows(); ++i) {
      const double h = hazard_of(eta[i]), e = std::expm1(h);
      eta[i] = of(i).y == 0 ? std::max(h, all_but_flat)
                            : std::max(1e-12, std::log1p(e * -std::expm1(-h) * of(i).n / of(i).y));
    }
    return eta;
  }

 protected:
  /// Share of all samples to which it happened.
  [[nodiscard]] double on_the_whole() const {
    double happened = 0, all = 1;
    for (const Row& row : list()) {
      happened += row.y;
      all += row.n;
    }
    return happened / all;
  }
  [[nodiscard]] static double hazard(double probability) {
    return -std::log1p(-std::min(0.9999, std::max(0.0, probability)));
  }
  [[nodiscard]] double log_likelihood(Eigen::Index row, double eta) const override {
    const double h = hazard_of(eta), y = of(row).y, n = of(row).n;
    if (y == 0) return -n * h;
    return y * std::log(-std::expm1(-h)) - (n - y) * h;
  }
  [[nodiscard]] double score(Eigen::Index row, double eta) const override {
    const double h = hazard_of(eta), y = of(row).y, n = of(row).n;
    if (y == 0 && eta < numbers::least_hazard) return 0;  // less than none is none
    return y / std::expm1(h) - (n - y);
  }
  [[nodiscard]] double information(Eigen::Index row, double eta) const override {
    return of(row).n / std::expm1(std::max(1e-12, eta));
  }

 private:
  static double hazard_of(double eta) { return std::max(numbers::least_hazard, eta); }
};

}  // namespace fit::explain::model
