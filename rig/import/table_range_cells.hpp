// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "rig/import/importer.hpp"
#include "rig/import/table_columns.hpp"

namespace rig::table_rows {

/// Makes ranges of a table's cells, and says over the whole table what in them cannot be: a unit, a decimal
/// sign or a code that was misread would else become "no echo" without a word.
class RangeCells {
 public:
  /// In millimetres as sessions hold it, of a cell with its column's scale and unit.
  std::uint16_t range(std::string_view cell, const TableColumn& column, std::uint64_t line);
  /// Likewise, of a distance that was computed from several cells; nothing: no echo.
  std::uint16_t range(std::optional<double> mm);
  /// At the end of the table. `decimal_comma`: its cells had commas where they now have points.
  void report(ImportSink& sink, bool decimal_comma) const;

 private:
  struct Cell {
    std::string text;
    std::uint64_t line = 0;
  };
  void look_for_thousands(std::string_view text, std::uint64_t line);

  std::uint64_t given_ = 0;  ///< Neither empty, nor 0, nor another word for no echo.
  std::uint64_t words_ = 0, out_of_reach_ = 0;
  std::uint64_t grouped_ = 0, short_whole_ = 0, ungrouped_ = 0;  ///< As 3,001, as 978, and as neither may be.
  bool several_short_ = false;  ///< Not one number again and again, as a code is.
  double largest_mm_ = 0, scale_ = 1;
  Cell first_word_, first_out_of_reach_, first_grouped_, first_short_;
};

}  // namespace rig::table_rows
