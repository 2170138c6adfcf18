// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "fit/explain/reduce.hpp"
#include "fit/radiometer.hpp"

namespace fit::explain::intensity {

/// The readings are cut into so many parts, each to be predicted from the others.
constexpr int held_out_parts = 5;

/// The mean intensity of one cell, or of a few neighbouring ones.
struct Reading {
  std::size_t cell = 0;      ///< Of Reduced::cells; the middle one of several.
  double reflectance = 0.5;  ///< Nominal, 0..1.
  double log_counts = 0;     ///< As it was recorded.
  int surface = 0;           ///< Target and grey: what shares one nominal reflectance.
  double sigma = 0.01;       ///< Standard uncertainty of `log_counts`.
};

/// What a recording says of intensity beside what its bench claims. Effects and columns that belong to it
/// have one row a reading and are of the logarithm of counts.
struct Readings {
  const Reduced& reduced;
  IntensityClaim claim;            ///< Where it states no gain, with the recording's own.
  std::vector<Reading> rows = {};  ///< In the order of the cells.
  std::vector<int> part = {};      ///< Of every row, 0 .. held_out_parts - 1.
  int surfaces = 0;
  double scatter = 0;  ///< Of neighbouring cells, relative; the middle one.
  double excess = 1;   ///< Factor on the variance of all rows: what neighbours share.

  [[nodiscard]] Eigen::Index count() const { return static_cast<Eigen::Index>(rows.size()); }
  [[nodiscard]] const Reading& row(Eigen::Index i) const { return rows[static_cast<std::size_t>(i)]; }
  [[nodiscard]] const Cell& cell(Eigen::Index i) const { return reduced.cells[row(i).cell]; }
  [[nodiscard]] const Group& group(Eigen::Index i) const {
    return reduced.groups[static_cast<std::size_t>(cell(i).group)];
  }
  [[nodiscard]] const Target& target(int index) const {
    return reduced.bench.targets[static_cast<std::size_t>(index)];
  }
  /// Logarithm of the counts by a law.
  [[nodiscard]] double predicted(Eigen::Index i, const IntensityLaw& law) const {
    return law.log_counts(row(i).reflectance, cell(i).at.cos_incidence, cell(i).at.range_mm);
  }
  /// Value of a coordinate, file unit, row by row; brightness as it is predicted.
  [[nodiscard]] Eigen::VectorXd coordinate(Coordinate coordinate) const;
};

/// Nothing when there is too little intensity to test a law.
[[nodiscard]] std::optional<Readings> readings_of(const Reduced& reduced, const IntensityClaim& claim);

/// Relative noise of one sample; the claimed one when too few cells show it.
[[nodiscard]] std::optional<double> sample_noise(const Readings& readings);

/// The coefficients that the bench file states.
[[nodiscard]] std::vector<int> stated_coefficients(const IntensityClaim& claim);

}  // namespace fit::explain::intensity
