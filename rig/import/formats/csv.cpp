// SPDX-License-Identifier: MIT
#include <algorithm>
#include <fstream>
#include <memory>

#include "rig/errors.hpp"
#include "rig/import/importer.hpp"
#include "rig/import/table_rows.hpp"
#include "rig/text_lines.hpp"

namespace rig::importers {
namespace {

using namespace table_rows;

/// Where there is a semicolon or a tabulator, a comma stands in numbers; a blank where there is none of them.
char separator_of(std::string_view line) {
  for (const char c : {';', '\t', ','})
    if (line.find(c) != std::string_view::npos) return c;
  return ' ';
}

/// The pieces between separators; one in quotation marks may hold separators.
Cells quoted_cells(std::string_view line, char separator) {
  Cells cells;
  for (const std::string_view piece : split(line, separator)) {
    const bool open = !cells.empty() && std::ranges::count(cells.back(), '"') % 2 == 1;
    if (open)
      cells.back() = std::string_view(
          cells.back().data(), static_cast<std::size_t>(piece.data() + piece.size() - cells.back().data()));
    else
      cells.push_back(piece);
  }
  return cells;
}

Cells cells_of(std::string_view line, char separator) {
  if (separator != ' ')
    return line.find('"') == line.npos ? split(line, separator) : quoted_cells(line, separator);
  Cells cells;
  for (const std::string_view cell : split(trimmed(line), ' ')) {
    if (cell.empty()) continue;
    // "angle (deg) range (mm)" are two names.
    if (!cells.empty() && (cell.front() == '(' || cell.front() == '['))
      cells.back() = std::string_view(
          cells.back().data(), static_cast<std::size_t>(cell.data() + cell.size() - cells.back().data()));
    else
      cells.push_back(cell);
  }
  return cells;
}

std::unique_ptr<Rows> rows_for(const Table& table) {
  const auto has = [&](Holds holds) { return table.find(holds) >= 0; };
  const bool wheels = has(Holds::left_wheel) && has(Holds::right_wheel);
  const auto ranges = std::ranges::count(table.columns, Holds::range, &TableColumn::holds);
  const bool angles = has(Holds::angle) || (has(Holds::turn) && ranges == 1);
  if (wheels && ranges == 0) return make_log_rows(table);
  if (ranges == 1 && angles) return make_point_rows(table);
  if (ranges == 0 && has(Holds::x) && has(Holds::y)) {
    if (has(Holds::heading) || has(Holds::turn)) return make_log_rows(table);
    return make_point_rows(table);
  }
  return make_scan_rows(table);
}

/// Tables as text, columns known by their names: one row a scan, one row a point, or one row a moment of a
/// drive.
class TableReader {
 public:
  TableReader(const std::string& path, const ImportOptions& options, ImportSink& sink)
      : table_{path, options, sink, {}, false} {}

  void read(std::istream& in) {
    std::string line;
    bool too_long = false;
    while (table_.sink.wants_more() && next_line(in, line, too_long)) {
      if (++table_.line == 1 && line.starts_with("\xEF\xBB\xBF"))
        line.erase(0, 3);  // a UTF-8 byte order mark
      if (!rows_) refuse_old_line_ends(line);
      if (trimmed(line).empty() || line.front() == '#') {
        if (!rows_ && !line.empty()) comment_ = line;
        continue;
      }
      if (first_) separator_ = separator_of(line);
      if ((separator_ == ';' || separator_ == '\t') && line.find(',') != line.npos) {
        std::ranges::replace(line, ',', '.');
        table_.decimal_comma = true;
      }
      if (rows_ && line == header_) continue;  // of the next of several files, one after the other
      take(line);
    }
    if (too_long) refuse_old_line_ends(line);
    if (too_long)
      throw UsageError(table_.path +
                       " has a line of more than four million characters: it is not a table of scans.");
    if (rows_) rows_->end();
    if (!rows_ && headers_ > 1) refuse_words();
  }

 private:
  void take(const std::string& line) {
    Cells cells = cells_of(line, separator_);
    if (cells.empty()) return;
    const bool number = number_in(cells.front()).has_value() || trimmed(cells.front()) == "nan";
    if (!rows_ && !number && ++headers_ == 2) {
      word_ = std::string(trimmed(cells.front()));
      word_line_ = table_.line;
    }
    if (first_ && !number) {
      table_.with_header = true;
      header_ = line;
      if (table_.options.columns.empty())
        for (const auto& cell : cells) table_.columns.push_back(column_of(cell));
    } else if (!first_ && !number && !rows_ && table_.with_header && cells.size() > 1) {
      refuse_intensities(cells);
    } else {
      if (!rows_) begin(cells);
      // An empty last cell.
      if (separator_ != ' ' && line.back() == separator_ && cells.size() < table_.columns.size())
        cells.emplace_back();
      if (has_more_than_columns(cells))
        rows_->leave_out_long_row();
      else
        rows_->row(cells);
    }
    first_ = false;
  }

  /// Separators at the end of a line make no columns.
  [[nodiscard]] bool has_more_than_columns(const Cells& cells) const {
    const std::size_t columns = table_.columns.size();
    return cells.size() > columns &&
           std::any_of(cells.begin() + static_cast<std::ptrdiff_t>(columns), cells.end(),
                       [](std::string_view cell) { return !trimmed(cell).empty(); });
  }

  void refuse_old_line_ends(const std::string& line) const {
    if (const auto text = trimmed(line); text.find('\r') != text.npos)
      throw UsageError(table_.path +
                       " ends its lines with CR alone, as old systems did. Write them anew: tr '\\r' '\\n' "
                       "< FILE > NEW.csv");
  }

  /// Nothing but headers: the first value of every row is no number.
  void refuse_words() const {
    const bool date = word_.size() >= 10 && word_[4] == '-' && word_[7] == '-';
    table_.ask("line " + std::to_string(word_line_) + " begins with '" + word_ +
                   "', which is no number, and no line below begins with one.",
               date ? "Dates are not read: write times as numbers, e.g. seconds in a column time_s."
                    : "Every row begins with a number; check what parts the columns (comma, semicolon, "
                      "tabulator or blanks).");
  }

  void begin(const Cells& cells) {
    if (!table_.options.columns.empty()) {
      try {
        table_.columns = columns_of(table_.options.columns, cells.size());
      } catch (const std::invalid_argument& error) {
        throw UsageError(error.what());
      }
      table_.with_header = false;
    } else if (table_.columns.empty()) {
      take_header_from_comment(cells.size());
    }
    if (table_.columns.empty()) {
      // Without any names: a first value too large for a range is a time in milliseconds.
      table_.columns.resize(cells.size());
      for (TableColumn& column : table_.columns) column.name = "value";
      if (cells.size() > 2 && number_in(cells[0]).value_or(0) >= 65536)
        table_.columns[0] = column_of("Timestamp");
    }
    if (has_more_than_columns(cells)) refuse_left_over(cells.size());
    if (headers_ > most_headers)
      table_.sink.note("The first row of numbers is line " + std::to_string(table_.line) +
                       ": the lines before it were passed over.");
    rows_ = rows_for(table_);
  }

  [[noreturn]] void refuse_left_over(std::size_t cells) const {
    const bool named = !table_.options.columns.empty();
    table_.ask(
        (named ? "--columns names " : "its header names ") + std::to_string(table_.columns.size()) +
            " columns, but line " + std::to_string(table_.line) + " holds " + std::to_string(cells) +
            " values.",
        std::string("Name every column with --columns: NAME* means all that remain, '-' passes over one.") +
            (separator_ == ',' ? " Where the comma is the decimal sign, part the columns with ';'." : ""));
  }

  /// numpy.savetxt and many loggers write the names behind a '#'.
  void take_header_from_comment(std::size_t cells) {
    const Cells names = cells_of(std::string_view(comment_).substr(comment_.empty() ? 0 : 1), separator_);
    if (names.size() != cells ||
        std::ranges::any_of(names, [](auto name) { return number_in(name).has_value(); }))
      return;
    for (const auto& name : names) table_.columns.push_back(column_of(name));
    table_.with_header = true;
  }

  void refuse_intensities(const Cells& cells) const {
    if (column_of(cells[1]).holds == Holds::intensity)
      throw UsageError(table_.path + " holds intensities without ranges. Import the file with the ranges.");
  }

  Table table_;
  char separator_ = ',';
  bool first_ = true;
  std::string comment_, header_, word_;
  static constexpr std::uint64_t most_headers = 2;  // as UrgBenri writes
  std::uint64_t headers_ = 0, word_line_ = 0;       ///< Lines before the first row; the second of them.
  std::unique_ptr<Rows> rows_;
};

class Csv : public Importer {
 public:
  std::string name() const override {
    return "CSV table (one row a scan, a point, or a moment of the wheels; .csv, .tsv, .txt, .dat)";
  }

  bool takes_columns() const override { return true; }

  bool recognises(const std::string& path, std::span<const std::uint8_t> first_bytes) const override {
    const std::string_view text(reinterpret_cast<const char*>(first_bytes.data()), first_bytes.size());
    // A damaged text has a zero here and there, a binary file or UTF-16 has many.
    const auto zeros = static_cast<std::size_t>(std::ranges::count(text, '\0'));
    if (text.empty() || zeros > text.size() / 100 || text.starts_with("[")) return false;
    return std::ranges::any_of(std::initializer_list<const char*>{".csv", ".CSV", ".tsv", ".txt", ".dat"},
                               [&](const char* ending) { return path.ends_with(ending); });
  }

  void read(const std::string& path, const ImportOptions& options, ImportSink& sink) const override {
    std::ifstream in(path, std::ios::binary);
    if (!in) throw UsageError(path + " cannot be opened. Check the name and the permissions.");
    TableReader(path, options, sink).read(in);
  }
};

}  // namespace

std::unique_ptr<Importer> make_csv() { return std::make_unique<Csv>(); }

}  // namespace rig::importers
