// SPDX-License-Identifier: MIT
#pragma once

#include <SQLiteCpp/SQLiteCpp.h>

#include <cmath>
#include <optional>

#include "fit/numeric/angle.hpp"

namespace rig {

/// Degrees as a person wrote them: 0.3 rather than the 0.30000000000000004 that a trip through radians
/// leaves.
inline double file_degrees(double rad) { return std::round(rad * fit::deg_per_rad * 1e9) / 1e9; }

template <class T, class F>
void bind_optional(SQLite::Statement& statement, int index, const std::optional<T>& value, F convert) {
  if (value)
    statement.bind(index, convert(*value));
  else
    statement.bind(index);
}

inline constexpr auto as_is = [](const auto& value) { return value; };

inline std::optional<double> optional_real(const SQLite::Statement& row, int index, double scale = 1) {
  const SQLite::Column column = row.getColumn(index);
  if (column.isNull()) return std::nullopt;
  return column.getDouble() * scale;
}

}  // namespace rig
