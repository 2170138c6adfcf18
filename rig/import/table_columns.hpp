// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace rig {

/// What one column of a table holds, known by its name and the unit at its end: "range_m", "angle (deg)",
/// "Timestamp [ms]", "ticks_left".
struct TableColumn {
  enum class Holds {
    unknown,
    nothing,  ///< Named "-": skipped.
    number,   ///< A running number or another quantity that is known and not used.
    time,
    scan,  ///< Tells scans apart, row by row.
    capture,
    angle,
    range,
    intensity,
    x,
    y,
    heading,
    turn,  ///< "theta": an angle beside ranges, else a heading.
    left_wheel,
    right_wheel,
    first_angle,  ///< Of the scan in this row, and so the next three.
    angle_step,
    scan_time,
    beam_time
  };
  Holds holds = Holds::unknown;
  std::string name;
  bool unit_known = false;
  double scale = 1;        ///< To ns, rad, mm, s; 1 where no unit is given.
  bool numbered = false;   ///< One of a row of columns: "range 17".
  bool ticks = false;      ///< Of a wheel: counts of its encoder, not an angle.
  bool increment = false;  ///< Of a wheel: since the row before.
  bool preferred = false;  ///< Of several times: the host's.
};

[[nodiscard]] TableColumn column_of(std::string_view name);

/// The list of --columns, with "NAME*3" for three columns of that name and "NAME*" for all that follow: as
/// many as `cells` needs. Throws std::invalid_argument.
[[nodiscard]] std::vector<TableColumn> columns_of(const std::vector<std::string>& names, std::size_t cells);

}  // namespace rig
