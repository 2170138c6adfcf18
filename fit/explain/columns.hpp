// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Dense>
#include <string>
#include <vector>

#include "fit/explain/mean_model.hpp"

namespace fit::explain {

/// A mechanism that moves means, with its values (in the order of its parameters).
struct Term {
  const Mechanism* mechanism = nullptr;
  int target = -1;
  std::vector<double> values;
  std::vector<double> sigma;  ///< Standard uncertainties of `values`; empty before the fit.

  [[nodiscard]] Active active() const { return {mechanism, values, target}; }
  [[nodiscard]] bool same(const Term& other) const {
    return mechanism == other.mechanism && target == other.target;
  }
};

/// Where an unnamed function acts.
enum class Channel { range, beam_angle, stage_angle };

/// d range / d what the channel changes: 1, or mm per rad.
[[nodiscard]] double lever_of(Channel channel, const Sight& sight);

/// Columns with priors, and what they mean.
struct Columns {
  Eigen::MatrixXd columns_mm;
  Prior prior;
};

/// What a term does to every mean to first order, mm; 0 where it says nothing.
[[nodiscard]] Eigen::VectorXd effect_of(const MeanModel& model, const Term& term);

/// Linear coefficients of a term: sizes as they are, a size with a phase as its sine and cosine part.
[[nodiscard]] std::vector<double> linear_coefficients(const Term& term);
/// Puts linear coefficients back, with their covariance (for uncertainties), shape parameters after them.
void set_coefficients(Term& term, const Eigen::VectorXd& values, const Eigen::MatrixXd& covariance);

/// Columns of the linear coefficients at the term's shape values, and their prior around zero.
[[nodiscard]] Columns linear_columns(const MeanModel& model, const Term& term);
/// Whether a term cuts ranges into bins: its effect jumps, and neighbouring beams differ.
[[nodiscard]] bool is_comb(const Mechanism& mechanism);
/// Whether a size is the amplitude of a wave, its phase being the next parameter.
[[nodiscard]] bool has_phase(const Mechanism& mechanism, std::size_t size);
/// Derivatives by the shape parameters, in the unit in which they are searched (logarithm or value).
[[nodiscard]] Columns shape_columns(const MeanModel& model, const Term& term);
/// A smooth correction of a few per cent on the term's own coordinate: real causes only resemble formulas.
/// Of play, where in it the stage stood before its first move.
[[nodiscard]] Columns freedom_columns(const MeanModel& model, const Term& term);
/// A row's coordinate, file unit; not finite where it has none.
[[nodiscard]] double coordinate_at(const MeanModel& model, Coordinate coordinate, Eigen::Index row);
/// The coordinate of every row, scaled to -1 .. 1 over the recording; where its values are very uneven,
/// partly by rank.
[[nodiscard]] Eigen::VectorXd scaled_coordinate(const MeanModel& model, Coordinate coordinate);

/// Joins columns side by side.
void add(Columns& all, const Columns& more);

}  // namespace fit::explain
