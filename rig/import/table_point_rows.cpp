// SPDX-License-Identifier: MIT
// One row a point: angle and range, or x and y.
#include "rig/import/beam_grid.hpp"
#include "rig/import/table_rows.hpp"

namespace rig::table_rows {
namespace {

class PointRows : public Rows {
 public:
  explicit PointRows(const Table& table)
      : Rows(table),
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
    length_unit_known_ = table.column(cartesian_ ? x_ : range_).unit_known;
  }

  void row(const Cells& cells) override {
    const auto scan = Table::cell(cells, scan_);
    const double capture = Table::cell(cells, capture_).value_or(0);
    const auto stamp = time_.present() ? time_.ns(cells) : std::optional<double>();
    ++rows_;
    std::optional<double> angle, range_mm;
    std::string fault = point_of(cells, angle, range_mm);
    if (scan_ >= 0 && !scan) fault = "the scan's number is no number";
    if (time_.present() && !stamp) fault = "the time is no number";
    if (!fault.empty()) {
      leave_out(fault);
      return;
    }
    if (angle) largest_angle_ = std::max(largest_angle_, std::abs(*angle));
    const bool other = scan_ >= 0 ? scan != last_scan_ || capture != last_capture_
                                  : (time_.present() && stamp != last_stamp_) || (angle && goes_back(*angle));
    if (other) flush();
    if (points_ == 0) stamp_ = stamp, first_line_ = table_.line;
    ++points_;
    last_scan_ = scan, last_capture_ = capture, last_stamp_ = stamp;
    if (!angle || angles_.size() >= most_values) return;
    angles_.push_back(*angle);
    ranges_.push_back(cartesian_ ? range_cells_.range(range_mm)
                                 : range_cells_.range(cells[static_cast<std::size_t>(range_)],
                                                      table_.column(range_), table_.line));
    if (intensity_column_ >= 0) intensities_.push_back(intensity_of(Table::cell(cells, intensity_column_)));
  }

  void end() override {
    flush();
    if (single_ > 10 && single_ > scans_)
      table_.ask("nearly every row has a different time, so times do not separate scans.",
                 "Add a column 'scan' that counts them, or leave the time out: --columns -,angle_deg,range_m "
                 "then begins a scan where the angle decreases.");
    if (!time_.present() && scans_ > 1) table_.invented_times();
    if (uneven_ > 0)
      table_.sink.note("The beams of " + std::to_string(uneven_) + " of " + std::to_string(scans_) +
                       " scans lie unevenly: their points were assigned to the nearest of evenly spaced "
                       "directions, at most " +
                       fit::format_fixed(farthest_rad_ * fit::deg_per_rad, 2) +
                       " deg off. --first-deg and --step-deg name other directions.");
    range_cells_.report(table_.sink, table_.decimal_comma);
    report_left_out(rows_);
  }

 private:
  /// Whether another scan begins at this angle, where nothing but the angles tells: it is more than a quarter
  /// turn from the one before, or back by more than half of the scan.
  [[nodiscard]] bool goes_back(double angle) const {
    constexpr std::size_t least_points = 10;
    if (angles_.empty() || cartesian_ || time_.present()) return false;
    const double quarter = largest_angle_ > 6.3 ? 90 : fit::pi / 2;  // Degrees where the unit is not stated.
    const double step = angle - angles_.back(), scan = angles_.back() - angles_.front();
    return std::abs(step) > quarter ||
           (angles_.size() >= least_points && step * scan < 0 && std::abs(step) > std::abs(scan) / 2);
  }
  /// What is wrong with a row, or ""; an angle of nothing for a point without an echo.
  std::string point_of(const Cells& cells, std::optional<double>& angle, std::optional<double>& range_mm) {
    if (static_cast<int>(cells.size()) <= (cartesian_ ? std::max(x_, y_) : std::max(angle_, range_)))
      return "too few values";
    if (!cartesian_) {
      const auto raw = Table::cell(cells, range_);
      if (raw && !length_unit_known_) lengths_.check(*raw);
      angle = table_.scaled(cells, angle_);
      if (!angle) return "the angle is no number";
      if (table_.column(angle_).unit_known && std::abs(*angle) > 4 * fit::pi)
        return "the angle is beyond two turns, as if its unit or the columns were others";
      return "";
    }
    const auto x = table_.scaled(cells, x_), y = table_.scaled(cells, y_);
    if (!x || !y) {  // "nan nan" is no echo, other words are counted.
      const int index = x ? y_ : x_;
      range_cells_.range(cells[static_cast<std::size_t>(index)], table_.column(index), table_.line);
      return "";
    }
    if (*x == 0 && *y == 0) return "";
    if (!length_unit_known_) lengths_.check(std::hypot(*x, *y));
    angle = std::atan2(*y, *x);
    range_mm = std::hypot(*x, *y);
    return "";
  }

  /// Whether the angles are radians or degrees must be stated where their size leaves it open.
  void check_angles() {
    if (cartesian_ || table_.column(angle_).unit_known || angle_checked_) return;
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
    if (!length_unit_known_) lengths_.decide();
    if (points_ == 1) ++single_;
    if (angles_.size() >= 2) {
      check_angles();
      place();
    } else if (points_ > 0) {
      leave_out("a scan of fewer than two points", first_line_, points_);
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
      leave_out("a scan whose angles lie on no even grid", first_line_, points_);
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

  Times time_;
  Lengths lengths_;
  RangeCells range_cells_;
  int scan_, capture_, angle_, range_, x_, y_, intensity_column_;
  bool cartesian_ = false, length_unit_known_ = false, angle_checked_ = false, in_degrees_ = false;
  std::optional<double> last_scan_, last_stamp_, stamp_;
  double last_capture_ = 0, farthest_rad_ = 0, largest_angle_ = 0;
  std::uint64_t points_ = 0, scans_ = 0, single_ = 0, uneven_ = 0, rows_ = 0, first_line_ = 0;
  std::vector<double> angles_;
  std::vector<std::uint16_t> ranges_, intensities_, range_mm_, intensity_;
};

}  // namespace

std::unique_ptr<Rows> make_point_rows(const Table& table) { return std::make_unique<PointRows>(table); }

}  // namespace rig::table_rows
