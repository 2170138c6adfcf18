// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>

#include "fit/mechanism.hpp"

namespace fit::explain::model {

/// Scans whose random angles and ranges all beams share.
struct Draws {
  std::size_t group = 0;
  int scans = 0;
};

/// Where one of the cells lies that were taken together in a row.
struct CellOfRow {
  double range_mm = 0, along_mm = 0;  ///< As in its circumstances.
};

/// Rows with a predictor to which effects add, each in circumstances of its own.
class Rows {
 public:
  virtual ~Rows() = default;

  [[nodiscard]] virtual Eigen::Index rows() const = 0;
  /// What the row's samples met.
  [[nodiscard]] virtual const Circumstances& at(Eigen::Index row) const = 0;
  /// What an effect adds to the row's predictor.
  [[nodiscard]] virtual double response(Eigen::Index row, const Effect& effect) const = 0;
  /// The cells that were taken together in the row, among which an effect may begin or end; empty: one.
  [[nodiscard]] virtual std::span<const CellOfRow> cells_of(Eigen::Index) const { return {}; }
  /// Times since the stage's last move of scans that were taken together in the row, where it shows by how
  /// much an angle differs among them; empty: it does not.
  [[nodiscard]] virtual std::span<const double> times_s(Eigen::Index) const { return {}; }
  /// Of a row that shows how much differs from scan to scan: those that it saw. None: it shows something
  /// else.
  [[nodiscard]] virtual Draws draws(Eigen::Index) const { return {}; }
};

}  // namespace fit::explain::model
