// SPDX-License-Identifier: MIT
#pragma once
// What a text table's rows become: scans (table_scan_rows.cpp), points (table_point_rows.cpp), or moments of
// a drive (table_log_rows.cpp). rig/import/formats/csv.cpp reads the text.

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "fit/numeric/angle.hpp"
#include "fit/numeric/number_format.hpp"
#include "rig/errors.hpp"
#include "rig/import/importer.hpp"
#include "rig/import/table_columns.hpp"
#include "rig/import/table_range_cells.hpp"
#include "rig/text_lines.hpp"

namespace rig::table_rows {

using Holds = TableColumn::Holds;
using Cells = std::vector<std::string_view>;

constexpr std::size_t most_values = 100'000;

/// What every shape of table needs to know.
struct Table {
  std::string path;
  const ImportOptions& options;
  ImportSink& sink;
  std::vector<TableColumn> columns;
  bool with_header = false;
  bool decimal_comma = false;  ///< Commas in numbers were replaced by points.
  std::uint64_t line = 0;      ///< Of the row that is read, from 1.

  [[nodiscard]] int find(Holds holds) const {
    int found = -1;
    for (std::size_t i = 0; i < columns.size(); ++i)
      if (columns[i].holds == holds && (found < 0 || columns[i].preferred)) found = static_cast<int>(i);
    return found;
  }
  [[nodiscard]] const TableColumn& column(int index) const {
    return columns[static_cast<std::size_t>(index)];
  }
  [[nodiscard]] static std::optional<double> cell(const Cells& cells, int index) {
    if (index < 0 || static_cast<std::size_t>(index) >= cells.size()) return std::nullopt;
    return number_in(cells[static_cast<std::size_t>(index)]);
  }
  /// In the column's inside unit.
  [[nodiscard]] std::optional<double> scaled(const Cells& cells, int index) const {
    const auto value = cell(cells, index);
    return value ? std::optional(*value * column(index).scale) : std::nullopt;
  }
  [[noreturn]] void ask(const std::string& what, const std::string& remedy) const {
    throw UsageError(path + ": " + what + " " + remedy);
  }
  void invented_times() const {
    sink.note("The table holds no times: its scans were taken " +
              fit::format_fixed(1000 / options.scan_hz.value_or(40), 1) +
              " ms apart. --scan-hz names another rate.");
  }
};

/// Times of a column that says its unit, or does not: a date of these years is recognised by its size, and
/// parts of a second by their fractions; anything else is asked for.
class Times {
 public:
  Times(const Table& table, int index) : table_(table), index_(index) {}

  [[nodiscard]] bool present() const { return index_ >= 0; }
  std::optional<double> ns(const Cells& cells) {
    const auto value = Table::cell(cells, index_);
    if (!value) return std::nullopt;
    if (!scale_) scale_ = scale_of(*value);
    return std::clamp(*value * *scale_, -9e18, 9e18);
  }

 private:
  double scale_of(double value) const {
    const TableColumn& column = table_.column(index_);
    if (column.unit_known) return column.scale;
    for (const double scale : {1e9, 1e6, 1e3, 1.0})
      if (value * scale > 9e17 && value * scale < 4e18) return scale;
    // UrgBenri counts the lidar's milliseconds.
    if (column.name == "Timestamp") return 1e6;
    if (value != std::floor(value)) return 1e9;
    table_.ask("column '" + column.name + "' does not say its unit.",
               "Name the columns: --columns time_ms,... (or time_s, time_us, time_ns).");
  }

  const Table& table_;
  int index_;
  std::optional<double> scale_;
};

/// The unit of ranges whose column does not say one: whole numbers that a lidar can mean as millimetres. What
/// looks like metres is asked for.
class Lengths {
 public:
  Lengths(const Table& table, std::string_view example) : table_(table), example_(example) {}

  void check(double raw) {
    if (raw <= 0 || std::isnan(raw)) return;
    ++seen_;
    largest_ = std::max(largest_, raw);
  }
  /// At the end of a scan.
  void decide() {
    if (decided_ || seen_ == 0) return;
    decided_ = true;
    if (largest_ > 100) return;
    table_.ask("its ranges reach " + fit::format_fixed(largest_, 3) +
                   " and their column does not say a unit: they cannot be millimetres.",
               "Name the columns: --columns " + std::string(example_) + ".");
  }

 private:
  const Table& table_;
  std::string_view example_;
  std::uint64_t seen_ = 0;
  double largest_ = 0;
  bool decided_ = false;
};

/// Makes something of a table's rows.
class Rows {
 public:
  explicit Rows(const Table& table) : table_(table) {}
  virtual ~Rows() = default;
  Rows(const Rows&) = delete;
  Rows& operator=(const Rows&) = delete;
  virtual void row(const Cells& cells) = 0;
  virtual void end() = 0;
  /// Counts rows that are not used, by the reason (as "too few values"), and remembers where the first
  /// stands.
  void leave_out(const std::string& why, std::uint64_t first_line, std::uint64_t rows = 1) {
    LeftOut& left_out = left_out_[why];
    if (left_out.rows == 0) left_out.first_line = first_line;
    left_out.rows += rows;
  }
  void leave_out(const std::string& why) { leave_out(why, table_.line); }
  /// In place of row().
  void leave_out_long_row() {
    leave_out("more values than columns");
    ++long_rows_;
  }

 protected:
  /// At the end. Where most rows are lost, the columns are not what they are said to be.
  void report_left_out(std::uint64_t rows) const {
    if (left_out_.empty()) return;
    rows += long_rows_;
    std::uint64_t count = 0;
    std::string reasons;
    for (const auto& [why, left_out] : left_out_) {
      count += left_out.rows;
      reasons += (reasons.empty() ? "" : "; ") + why + " (" + std::to_string(left_out.rows) +
                 ", the first in line " + std::to_string(left_out.first_line) + ")";
    }
    const std::string said = std::to_string(count) + " of " + std::to_string(rows) +
                             " rows were truncated or implausible and left out: " + reasons + ".";
    if (2 * count > rows)
      table_.sink.doubt(said +
                        " Check the names, units and order of the columns, or give them with --columns.");
    else
      table_.sink.note(said);
  }

  const Table& table_;

 private:
  struct LeftOut {
    std::uint64_t rows = 0, first_line = 0;
  };
  std::map<std::string, LeftOut> left_out_;
  std::uint64_t long_rows_ = 0;
};

inline void set_scan_time(fit::ScanGeometry& geometry, std::size_t beams, double scan_hz) {
  geometry.scan_s = std::abs(geometry.step_rad) * static_cast<double>(beams) / (2 * fit::pi * scan_hz);
}

inline void give_scan(const Table& table, double stamp_ns, const fit::ScanGeometry& geometry,
                      std::span<const std::uint16_t> range_mm, std::span<const std::uint16_t> intensity) {
  ImportedScan out;
  out.stamp_ns = static_cast<std::int64_t>(std::clamp(stamp_ns, -9e18, 9e18));
  out.source = "CSV";
  out.frame = "lidar";
  out.geometry = geometry;
  out.range_mm = range_mm;
  out.intensity = intensity;
  table.sink.scan(out);
}

std::unique_ptr<Rows> make_scan_rows(const Table& table);
std::unique_ptr<Rows> make_point_rows(const Table& table);
std::unique_ptr<Rows> make_log_rows(const Table& table);

}  // namespace rig::table_rows
