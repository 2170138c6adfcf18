// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <fstream>
#include <memory>

#include "fit/number_format.hpp"
#include "rig/errors.hpp"
#include "rig/import/beam_grid.hpp"
#include "rig/import/importer.hpp"
#include "rig/import/table_columns.hpp"
#include "rig/import/wheel_counter.hpp"
#include "rig/text_lines.hpp"

namespace rig::importers {
namespace {

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
  void faulty_rows(std::uint64_t count) const {
    if (count > 0)
      sink.note(std::to_string(count) + " rows or scans were truncated or implausible and left out.");
  }
};

/// Times of a column that says its unit, or does not: a date of these years is recognised by its size, and
/// parts of a second by their fractions; anything else is asked for.
class Times {
 public:
  Times(const Table& table, int index) : table_(table), index_(index) {}

  [[nodiscard]] bool told() const { return index_ >= 0; }
  std::optional<double> ns(const Cells& cells) {
    const auto value = Table::cell(cells, index_);
    if (!value) return std::nullopt;
    if (!scale_) scale_ = scale_of(*value);
    return std::clamp(*value * *scale_, -9e18, 9e18);
  }

 private:
  double scale_of(double value) const {
    const TableColumn& column = table_.column(index_);
    if (column.unit_told) return column.scale;
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
    fractions_ = fractions_ || raw != std::floor(raw);
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
  bool fractions_ = false, decided_ = false;
};

/// Makes something of a table's rows.
class Rows {
 public:
  virtual ~Rows() = default;
  virtual void row(const Cells& cells) = 0;
  virtual void end() = 0;
};

void set_scan_time(fit::ScanGeometry& geometry, std::size_t beams, double scan_hz) {
  geometry.scan_s = std::abs(geometry.step_rad) * static_cast<double>(beams) / (2 * fit::pi * scan_hz);
}

void give_scan(const Table& table, double stamp_ns, const fit::ScanGeometry& geometry,
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

// --- one row a scan -------------------------------------------------------------------------------------

class ScanRows : public Rows {
 public:
  explicit ScanRows(const Table& table)
      : table_(table), time_(table, table.find(Holds::time)), lengths_(table, "time_s,range_m*360") {
    choose_columns();
  }

  void row(const Cells& cells) override {
    ++rows_;
    const std::size_t last = ranges_.empty() ? 0 : ranges_.back();
    if (ranges_.empty() || cells.size() <= last || ranges_.size() > most_values) {
      ++faulty_;
      return;
    }
    std::optional<double> stamp = time_.told() ? time_.ns(cells) : std::optional<double>();
    if (time_.told() && !stamp) {
      ++faulty_;
      return;
    }
    const fit::ScanGeometry geometry = geometry_of(cells);
    range_mm_.clear(), intensity_.clear();
    for (const std::size_t i : ranges_) {
      const auto value = number_in(cells[i]);
      if (!told_ && value) lengths_.check(*value);
      range_mm_.push_back(range_of(value ? std::optional(*value * table_.columns[i].scale) : std::nullopt));
    }
    if (!told_) lengths_.decide();
    for (const std::size_t i : intensities_)
      if (i < cells.size()) intensity_.push_back(intensity_of(number_in(cells[i])));
    if (intensity_.size() != range_mm_.size()) intensity_.clear();
    const double period_ns = 1e9 / table_.options.scan_hz.value_or(40);
    give_scan(table_, stamp.value_or(static_cast<double>(rows_ - 1) * period_ns), geometry, range_mm_,
              intensity_);
  }

  void end() override {
    if (!time_.told() && rows_ > 1) table_.invented_times();
    if (several_) table_.sink.note("The table holds several echoes a step: the first was used.");
    table_.faulty_rows(faulty_);
  }

 private:
  /// Columns called ranges, or, where none is, all that are called nothing that rig knows. Of several with
  /// the same name (echoes of one step) the first.
  void choose_columns() {
    const auto& columns = table_.columns;
    const bool named = std::ranges::any_of(columns, [](const auto& c) { return c.holds == Holds::range; });
    for (std::size_t i = 0; i < columns.size(); ++i) {
      if (columns[i].holds == Holds::intensity) intensities_.push_back(i);
      if (columns[i].holds != (named ? Holds::range : Holds::unknown) || columns[i].name.empty()) continue;
      if (table_.with_header && !ranges_.empty() && columns[ranges_.back()].name == columns[i].name) {
        several_ = true;
        continue;
      }
      ranges_.push_back(i);
      told_ = told_ && columns[i].unit_told;
    }
  }

  fit::ScanGeometry geometry_of(const Cells& cells) {
    const auto first = table_.scaled(cells, table_.find(Holds::first_angle)),
               step = table_.scaled(cells, table_.find(Holds::angle_step));
    if (first && step && *step != 0) {
      fit::ScanGeometry geometry{*first, *step, {}};
      const auto beam_ns = table_.scaled(cells, table_.find(Holds::beam_time));
      const auto scan_ns = table_.scaled(cells, table_.find(Holds::scan_time));
      const double turns = std::abs(*step) * static_cast<double>(ranges_.size()) / (2 * fit::pi);
      if (table_.options.scan_hz)
        set_scan_time(geometry, ranges_.size(), *table_.options.scan_hz);
      else if (beam_ns && *beam_ns > 0)
        geometry.scan_s = *beam_ns * 1e-9 * static_cast<double>(ranges_.size());
      else if (scan_ns && *scan_ns > 0)
        geometry.scan_s = *scan_ns * 1e-9 * std::min(1.0, turns);
      return geometry;
    }
    if (!geometry_) geometry_ = geometry_for(ranges_.size());
    return *geometry_;
  }

  [[nodiscard]] fit::ScanGeometry geometry_for(std::size_t beams) const {
    struct Known {
      std::size_t beams;
      double first_deg, step_deg, hz;
      const char* model;
    };
    constexpr Known known[] = {{1081, -135, 0.25, 40, "UST-10LX"},
                               {682, -119.53125, 0.3515625, 10, "URG-04LX"},
                               {726, -135, 0.3515625, 10, "URG-04LX"}};
    fit::ScanGeometry geometry;
    const ImportOptions& options = table_.options;
    if (options.first_deg && options.step_deg && *options.step_deg != 0) {
      geometry.first_rad = *options.first_deg * fit::rad_per_deg;
      geometry.step_rad = *options.step_deg * fit::rad_per_deg;
    } else {
      const auto model = std::ranges::find(known, beams, &Known::beams);
      if (model == std::end(known))
        table_.ask(
            "it has " + std::to_string(beams) + " values a scan and does not say the angles of its beams.",
            "Give --first-deg and --step-deg; or, if its rows are not scans, name the columns: --columns "
            "time_s,left_ticks,right_ticks or scan,angle_deg,range_m or scan,x_m,y_m.");
      geometry.first_rad = model->first_deg * fit::rad_per_deg;
      geometry.step_rad = model->step_deg * fit::rad_per_deg;
      if (!options.scan_hz) set_scan_time(geometry, beams, model->hz);
      table_.sink.property("model", model->model);
      table_.sink.note(std::string("The beams were assumed to lie as those of a ") + model->model +
                       ". Give --first-deg and --step-deg if that is wrong.");
    }
    if (options.scan_hz) set_scan_time(geometry, beams, *options.scan_hz);
    return geometry;
  }

  const Table& table_;
  Times time_;
  Lengths lengths_;
  std::vector<std::size_t> ranges_, intensities_;
  bool several_ = false, told_ = true;
  std::optional<fit::ScanGeometry> geometry_;
  std::uint64_t rows_ = 0, faulty_ = 0;
  std::vector<std::uint16_t> range_mm_, intensity_;
};

// --- one row a point: angle and range, or x and y -------------------------------------------------------

class PointRows : public Rows {
 public:
  explicit PointRows(const Table& table)
      : table_(table),
        time_(table, table.find(Holds::time)),
        lengths_(table, "scan,angle_deg,range_m"),
        scan_(table.find(Holds::scan)),
        capture_(table.find(Holds::capture)),
        angle_(table.find(Holds::angle) >= 0 ? table.find(Holds::angle) : table.find(Holds::turn)),
        range_(table.find(Holds::range)),
        x_(table.find(Holds::x)),
        y_(table.find(Holds::y)),
        intensity_column_(table.find(Holds::intensity)) {
    cartesian_ = range_ < 0 || angle_ < 0;
    length_told_ = table.column(cartesian_ ? x_ : range_).unit_told;
  }

  void row(const Cells& cells) override {
    const auto scan = Table::cell(cells, scan_);
    const double capture = Table::cell(cells, capture_).value_or(0);
    const auto stamp = time_.told() ? time_.ns(cells) : std::optional<double>();
    std::optional<double> angle, range;
    if (!point(cells, angle, range) || (scan_ >= 0 && !scan) || (time_.told() && !stamp)) {
      ++faulty_;
      return;
    }
    if (angle) largest_angle_ = std::max(largest_angle_, std::abs(*angle));
    const double quarter = largest_angle_ > 6.3 ? 90 : fit::pi / 2;  // Degrees where the unit is not told.
    const bool back = angle && !angles_.empty() && !cartesian_ && scan_ < 0 && !time_.told() &&
                      std::abs(*angle - angles_.back()) > quarter;
    const bool other = scan_ >= 0 ? scan != last_scan_ || capture != last_capture_
                                  : (time_.told() && stamp != last_stamp_) || back;
    if (other) flush();
    if (points_ == 0) stamp_ = stamp;
    ++points_;
    last_scan_ = scan, last_capture_ = capture, last_stamp_ = stamp;
    if (!angle || angles_.size() >= most_values) return;
    angles_.push_back(*angle);
    ranges_.push_back(range_of(range));
    if (intensity_column_ >= 0) intensities_.push_back(intensity_of(Table::cell(cells, intensity_column_)));
  }

  void end() override {
    flush();
    if (single_ > 10 && single_ > scans_)
      table_.ask("nearly every row has a different time, so times do not separate scans.",
                 "Add a column 'scan' that counts them, or leave the time out: --columns -,angle_deg,range_m "
                 "then begins a scan where the angle decreases.");
    if (!time_.told() && scans_ > 1) table_.invented_times();
    if (uneven_ > 0)
      table_.sink.note("The beams of " + std::to_string(uneven_) + " of " + std::to_string(scans_) +
                       " scans lie unevenly: their points were assigned to the nearest of evenly spaced "
                       "directions, at most " +
                       fit::format_fixed(farthest_rad_ * fit::deg_per_rad, 2) +
                       " deg off. --first-deg and --step-deg name other directions.");
    table_.faulty_rows(faulty_);
  }

 private:
  /// False for a row that is none; an angle of nothing for a point without an echo.
  bool point(const Cells& cells, std::optional<double>& angle, std::optional<double>& range) {
    if (!cartesian_) {
      const auto raw = Table::cell(cells, range_);
      if (raw && !length_told_) lengths_.check(*raw);
      angle = table_.scaled(cells, angle_);
      range = table_.scaled(cells, range_);
      return angle.has_value() && static_cast<std::size_t>(range_) < cells.size();
    }
    const auto x = table_.scaled(cells, x_), y = table_.scaled(cells, y_);
    const bool there = std::max(x_, y_) < static_cast<int>(cells.size());
    if (!x || !y || (*x == 0 && *y == 0)) return there;  // "nan nan" and "0 0": no echo
    if (!length_told_) lengths_.check(std::hypot(*x, *y));
    angle = std::atan2(*y, *x);
    range = std::hypot(*x, *y);
    return true;
  }

  /// Whether the angles are radians or degrees must be told where their size leaves it open.
  void check_angles() {
    if (cartesian_ || table_.column(angle_).unit_told || angle_checked_) return;
    angle_checked_ = true;
    const double largest = std::abs(
        *std::ranges::max_element(angles_, [](double a, double b) { return std::abs(a) < std::abs(b); }));
    if (largest <= 6.3)
      table_.ask(
          "column '" + table_.column(angle_).name + "' does not say whether it holds degrees or radians.",
          "Name the columns: --columns scan,angle_rad,range_mm (or angle_deg).");
    in_degrees_ = true;
  }

  void flush() {
    if (!length_told_) lengths_.decide();
    if (points_ == 1) ++single_;
    if (angles_.size() >= 2) {
      check_angles();
      place();
    } else if (points_ > 0) {
      ++faulty_;
    }
    angles_.clear(), ranges_.clear(), intensities_.clear();
    points_ = 0;
  }

  void place() {
    if (in_degrees_)
      for (double& angle : angles_) angle *= fit::rad_per_deg;
    std::optional<fit::ScanGeometry> known;
    const ImportOptions& options = table_.options;
    if (options.first_deg && options.step_deg && *options.step_deg != 0)
      known =
          fit::ScanGeometry{*options.first_deg * fit::rad_per_deg, *options.step_deg * fit::rad_per_deg, {}};
    const auto grid = beam_grid(angles_, known);
    if (!grid || grid->doubled * 20 > angles_.size() || grid->beams > 20 * angles_.size() + 100) {
      ++faulty_;
      return;
    }
    ++scans_;
    if (grid->farthest_rad > 0.25 * std::abs(grid->geometry.step_rad)) {
      ++uneven_;
      farthest_rad_ = std::max(farthest_rad_, grid->farthest_rad);
    }
    range_mm_.assign(grid->beams, 0);
    intensity_.assign(intensities_.empty() ? 0 : grid->beams, 0);
    for (std::size_t i = angles_.size(); i-- > 0;) {  // of two on one direction the first stays
      range_mm_[grid->place[i]] = ranges_[i];
      if (!intensity_.empty()) intensity_[grid->place[i]] = intensities_[i];
    }
    fit::ScanGeometry geometry = grid->geometry;
    if (options.scan_hz) set_scan_time(geometry, grid->beams, *options.scan_hz);
    const double number = last_scan_.value_or(static_cast<double>(scans_ - 1));
    give_scan(table_, stamp_.value_or(number * 1e9 / options.scan_hz.value_or(40)), geometry, range_mm_,
              intensity_);
  }

  const Table& table_;
  Times time_;
  Lengths lengths_;
  int scan_, capture_, angle_, range_, x_, y_, intensity_column_;
  bool cartesian_ = false, length_told_ = false, angle_checked_ = false, in_degrees_ = false;
  std::optional<double> last_scan_, last_stamp_, stamp_;
  double last_capture_ = 0, farthest_rad_ = 0, largest_angle_ = 0;
  std::uint64_t points_ = 0, scans_ = 0, single_ = 0, uneven_ = 0, faulty_ = 0;
  std::vector<double> angles_;
  std::vector<std::uint16_t> ranges_, intensities_, range_mm_, intensity_;
};

// --- one row a moment: wheels, poses, or both -----------------------------------------------------------

class LogRows : public Rows {
 public:
  explicit LogRows(const Table& table)
      : table_(table),
        time_(table, table.find(Holds::time)),
        x_(table.find(Holds::x)),
        y_(table.find(Holds::y)),
        heading_(table.find(Holds::heading) >= 0 ? table.find(Holds::heading) : table.find(Holds::turn)),
        left_(table.find(Holds::left_wheel)),
        right_(table.find(Holds::right_wheel)),
        left_counter_(counter(left_)),
        right_counter_(counter(right_)) {
    if (!time_.told())
      table.ask("it holds wheels or poses without their times.",
                "Name the columns: --columns time_s,left_ticks,right_ticks.");
    for (const int index : {x_, y_})
      if (index >= 0 && !table.column(index).unit_told)
        table.ask("column '" + table.column(index).name + "' does not say its unit.",
                  "Name the columns: --columns time_s,x_m,y_m,heading_rad,left_ticks,right_ticks.");
    if (heading_ >= 0 && !table.column(heading_).unit_told)
      table.ask(
          "column '" + table.column(heading_).name + "' does not say whether it holds degrees or radians.",
          "Name the columns: --columns time_s,x_m,y_m,heading_rad (or heading_deg).");
  }

  void row(const Cells& cells) override {
    const auto stamp = time_.ns(cells);
    const auto x = table_.scaled(cells, x_), y = table_.scaled(cells, y_),
               heading = table_.scaled(cells, heading_);
    const auto left = table_.scaled(cells, left_), right = table_.scaled(cells, right_);
    // Exports of several things in one table leave cells empty; a row that tells neither is cut.
    const bool wheels = left && right, placed = x && y && (heading || heading_ < 0);
    if (!stamp || (!wheels && !placed)) {
      ++faulty_;
      return;
    }
    fit::TrackPose pose;
    if (placed) pose.x_mm = x, pose.y_mm = y, pose.heading_rad = heading;
    if (wheels) {
      pose.wheel_left_rad = left_counter_.angle(*left);
      pose.wheel_right_rad = right_counter_.angle(*right);
    }
    backwards_ += last_ && *stamp <= *last_ ? 1 : 0;
    last_ = stamp;
    table_.sink.pose(static_cast<std::int64_t>(*stamp), wheels ? "wheels" : "poses", "", pose);
  }

  void end() override {
    if (backwards_ > 0)
      table_.sink.note(std::to_string(backwards_) + " rows carry a time that is not after the one before.");
    if (left_counter_.overflows() + right_counter_.overflows() > 0)
      table_.sink.note("The encoders' counts overflowed " +
                       std::to_string(left_counter_.overflows() + right_counter_.overflows()) +
                       " times (16 bits): they were unwrapped.");
    table_.faulty_rows(faulty_);
  }

 private:
  [[nodiscard]] WheelCounter counter(int index) const {
    if (index < 0) return WheelCounter(1, false);
    const TableColumn& column = table_.column(index);
    if (!column.ticks) return WheelCounter(2 * fit::pi, column.increment);
    if (!table_.options.ticks_a_turn)
      table_.ask(
          "it counts the wheels in ticks and does not say how many make one turn.",
          "Give --ticks-a-turn, the gear included: 64 counts a turn of the motor and a gear of 43.7 are "
          "2796.8; or name columns left_rad,right_rad with --columns.");
    return WheelCounter(*table_.options.ticks_a_turn, column.increment);
  }

  const Table& table_;
  Times time_;
  int x_, y_, heading_, left_, right_;
  WheelCounter left_counter_, right_counter_;
  std::optional<double> last_;
  std::uint64_t faulty_ = 0, backwards_ = 0;
};

// --------------------------------------------------------------------------------------------------------

/// The separator that a line has most of; a blank where it has none.
char separator_of(std::string_view line) {
  char best = ' ';
  std::ptrdiff_t most = 0;
  for (const char c : {',', ';', '\t'})
    if (const auto count = std::ranges::count(line, c); count > most) best = c, most = count;
  return best;
}

Cells cells_of(std::string_view line, char separator) {
  if (separator != ' ') return split(line, separator);
  Cells cells;
  for (const std::string_view cell : split(trimmed(line), ' '))
    if (!cell.empty()) cells.push_back(cell);
  return cells;
}

std::unique_ptr<Rows> rows_for(const Table& table) {
  const auto has = [&](Holds holds) { return table.find(holds) >= 0; };
  const bool wheels = has(Holds::left_wheel) && has(Holds::right_wheel);
  const auto ranges = std::ranges::count(table.columns, Holds::range, &TableColumn::holds);
  const bool angles = has(Holds::angle) || (has(Holds::turn) && ranges == 1);
  if (wheels && ranges == 0) return std::make_unique<LogRows>(table);
  if (ranges == 1 && angles) return std::make_unique<PointRows>(table);
  if (ranges == 0 && has(Holds::x) && has(Holds::y)) {
    if (has(Holds::heading) || has(Holds::turn)) return std::make_unique<LogRows>(table);
    return std::make_unique<PointRows>(table);
  }
  return std::make_unique<ScanRows>(table);
}

/// Tables as text, columns told by their names: one row a scan, one row a point, or one row a moment of a
/// drive.
class TableReader {
 public:
  TableReader(const std::string& path, const ImportOptions& options, ImportSink& sink)
      : table_{path, options, sink, {}, false} {}

  void read(std::istream& in) {
    std::string line;
    bool too_long = false;
    while (table_.sink.wants_more() && next_line(in, line, too_long)) {
      if (trimmed(line).empty() || line.front() == '#') {
        if (!rows_ && !line.empty()) comment_ = line;
        continue;
      }
      take(line);
    }
    if (too_long)
      throw UsageError(table_.path +
                       " has a line of more than four million characters: it is not a table of scans.");
    if (rows_) rows_->end();
  }

 private:
  void take(const std::string& line) {
    if (first_) separator_ = separator_of(line);
    const Cells cells = cells_of(line, separator_);
    if (cells.empty()) return;
    const bool number = number_in(cells.front()).has_value() || trimmed(cells.front()) == "nan";
    if (first_ && !number) {
      table_.with_header = true;
      if (table_.options.columns.empty())
        for (const auto& cell : cells) table_.columns.push_back(column_of(cell));
    } else if (!first_ && !number && !rows_ && table_.with_header && cells.size() > 1) {
      refuse_intensities(cells);
    } else {
      if (!rows_) begin(cells);
      rows_->row(cells);
    }
    first_ = false;
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
    rows_ = rows_for(table_);
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
  std::string comment_;
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
    if (text.empty() || text.find('\0') != text.npos || text.starts_with("[")) return false;
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
