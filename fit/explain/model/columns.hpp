// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Dense>
#include <string>
#include <vector>

#include "fit/explain/model/mean_model.hpp"

namespace fit::explain::model {

class ChannelRows;

}  // namespace fit::explain::model

namespace fit::explain {

/// In the place of a target's number: one after the other, side by side.
constexpr int all_targets = -2;

/// What an unnamed function changes: the range, mm, or its scale, an angle, rad, or where the surface lies,
/// mm out along its normal.
enum class Channel { range, range_scale, beam_angle, stage_angle, place };

/// How files and people are told of it.
struct ChannelInWords {
  const char *key, *what, *unit;
  double in_unit;      ///< From the inside's unit to that one.
  double least_sensitivity;  ///< A mean of less says little about the function.
};
[[nodiscard]] const ChannelInWords& in_words_of(Channel channel);

/// d range / d what the channel changes: 1, the range, mm per rad, or 1 over the cosine of the incidence.
[[nodiscard]] double sensitivity_of(Channel channel, const Sight& sight);

/// What a term does to every mean to first order, mm; 0 where it says nothing.
[[nodiscard]] Eigen::VectorXd effect_of(const MeanModel& model, const Active& term);

/// A term's columns: of its sizes, with the catalogue's priors; of its shapes, in units of their priors; and
/// of how real causes deviate from its formula.
struct TermColumns {
  Eigen::VectorXd at;  ///< Present values of the sizes.
  Columns sizes, shapes, deviations;
};
[[nodiscard]] TermColumns columns_of(const MeanModel& model, const Active& term);

/// What uncertain values of known mechanisms leave open in the rows of a channel: a column for one standard
/// uncertainty of each.
[[nodiscard]] Columns uncertain_values(const model::Rows& rows, const std::vector<Active>& known);
/// The same, and columns of how real causes deviate from formulas.
[[nodiscard]] Columns uncertainty_columns(const model::Rows& rows, std::vector<Active> known);
/// Makes nuisances of a channel of them, as far as it sees what they depend on.
void append_uncertainty(std::vector<Active> known, model::ChannelRows& rows);

/// A row's coordinate, file unit, or its place along a target (model::place_of); not finite where it has
/// none.
[[nodiscard]] double coordinate_at(const MeanModel& model, Coordinate coordinate, Eigen::Index row,
                                   int target = -1);
/// The same of every row, scaled to -1 .. 1 over the recording (model/scale.hpp).
[[nodiscard]] Eigen::VectorXd scaled_coordinate(const MeanModel& model, Coordinate coordinate,
                                                int target = -1);
/// What a place along a target is called.
[[nodiscard]] std::string place_along(const Bench& bench, int target);

}  // namespace fit::explain
