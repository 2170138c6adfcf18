// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "fit/explain/reduce.hpp"
#include "fit/explain/spread/interval.hpp"
#include "fit/mechanism.hpp"

namespace fit::explain::spread {

/// Neighbouring cells of one target in one group: the variance (mm^2) of one sample about its cell's mean,
/// and the means of what it may depend on.
struct Pool {
  double freedom = 0, variance = 0, beam_deg = 0, intensity = 0;
  double kurtosis = 0;  ///< Of samples; 3 of a normal distribution.
  double range_mm = 0, incidence_deg = 0;
  double lost = 0;  ///< Samples without echo, beside the others.
  double lever2 = 0;  ///< Of d range / d beam angle, (mm/rad)^2.
  int capture = 0, target = 0;
  double time_s = 0;  ///< Since power-on.
  double stage_deg = 0;
};

/// Where a pool lies on a coordinate; noise knows no sign of the incidence.
[[nodiscard]] double place_of(const Pool& pool, Coordinate coordinate);

[[nodiscard]] std::vector<Pool> pools_of(const Reduced& reduced);

/// A number for every pool: the variance, mm^2, that one part of the noise has there if its size is one.
using Column = std::vector<double>;

/// What the noise consists of beside the same for all pools.
struct Parts {
  std::vector<Column> columns;
  std::size_t places = 0;  ///< The first so many are differences between places and may be negative.
  bool free = false;       ///< The stated noise is no constraint.

  [[nodiscard]] Parts with(const Column& column) const;
  [[nodiscard]] Parts without(const std::set<std::size_t>& columns) const;
};

/// Sum of variances with non-negative sizes, fitted by the likelihood of the pools' sample variances.
class VarianceModel {
 public:
  /// `stated_mm`: the noise as the bench has it; `fixed_mm2`: a variance that is there anyway;
  /// `worth_of_sample`: in units of what one without memory says of a normal distribution's variance. It is
  /// less if samples have tails.
  VarianceModel(std::vector<Pool> pools, Estimate stated_mm, double fixed_mm2, double worth_of_sample);

  [[nodiscard]] const std::vector<Pool>& pools() const { return pools_; }
  /// The constant variance as the bench has it, mm^2.
  [[nodiscard]] Estimate stated_variance() const;

  struct Fit {
    Eigen::VectorXd value, sigma;  ///< First: the constant variance, then one for each column.
    double log_likelihood = 0;

    [[nodiscard]] Estimate at(std::size_t index) const;
    [[nodiscard]] Estimate last() const;
  };
  [[nodiscard]] Fit fit(const Parts& parts) const;

  /// The variance of every pool as fitted, mm^2.
  [[nodiscard]] std::vector<double> variances(const Parts& parts, const Fit& fit) const;
  [[nodiscard]] double worth_of_sample() const { return worth_of_sample_; }
  /// The step in which ranges come, mm.
  [[nodiscard]] double step_mm() const { return std::sqrt(12 * fixed_mm2_); }

  /// The block of every capture, eight at most, one of which at a time a law is not fitted to. Empty with
  /// fewer than three captures.
  [[nodiscard]] std::map<int, int> block_of_captures() const;
  /// What one more column gains in captures that it was not fitted to, each with its own constant noise. Not
  /// known with fewer than three; none, unless two confirm it and fewer deny it.
  [[nodiscard]] std::optional<double> unseen_gain(const Parts& parts, const Column& more) const {
    return unseen_gain(parts, parts.with(more));
  }
  /// ... and what more than one gains.
  [[nodiscard]] std::optional<double> unseen_gain(const Parts& parts, const Parts& with_more) const;
  /// What it all gains there, the constant noise being that of the other captures as well. Not known with
  /// fewer than three.
  [[nodiscard]] std::optional<double> held_out_gain(const Parts& parts, const Parts& with_more) const;

 private:
  /// Some of its pools, each sample worth what it is in the whole.
  [[nodiscard]] VarianceModel only(const std::vector<bool>& wanted) const;
  /// Calls `each` for every block of captures with the log-likelihood of its pools as a function of parts
  /// that are fitted to all others. False with fewer than three captures.
  template <class Each>
  bool for_blocks(const Each& each) const;
  [[nodiscard]] double mean_variance() const;
  [[nodiscard]] Eigen::VectorXd start(const Parts& parts) const;
  [[nodiscard]] double with_own_constant(const Parts& parts, Eigen::VectorXd x) const;
  [[nodiscard]] double likelihood(const Parts& parts, const Eigen::VectorXd& x) const;

  std::vector<Pool> pools_;
  Estimate stated_mm_;
  double fixed_mm2_, worth_of_sample_;
};

}  // namespace fit::explain::spread
