// SPDX-License-Identifier: MIT
// One row a scan.
#include "rig/import/table_rows.hpp"

namespace rig::table_rows {
namespace {

/// Lidars report three echoes a step at most; more columns of one name are steps.
constexpr std::size_t most_echoes = 8;

class ScanRows : public Rows {
 public:
  explicit ScanRows(const Table& table)
      : Rows(table), time_(table, table.find(Holds::time)), lengths_(table, "time_s,range_m*360") {
    choose_columns();
  }

  void row(const Cells& cells) override {
    ++rows_;
    const std::size_t last = ranges_.empty() ? 0 : ranges_.back();
    if (ranges_.empty() || ranges_.size() > most_values) {
      leave_out("no columns of ranges");
      return;
    }
    if (cells.size() <= last) {
      leave_out("fewer than " + std::to_string(last + 1) + " values");
      return;
    }
    std::optional<double> stamp = time_.present() ? time_.ns(cells) : std::optional<double>();
    if (time_.present() && !stamp) {
      leave_out("the time is no number");
      return;
    }
    const fit::ScanGeometry geometry = geometry_of(cells);
    range_mm_.clear(), intensity_.clear();
    for (const std::size_t i : ranges_) {
      if (!units_known_)
        if (const auto value = number_in(cells[i])) lengths_.check(*value);
      range_mm_.push_back(range_cells_.range(cells[i], table_.columns[i], table_.line));
    }
    if (!units_known_) lengths_.decide();
    for (const std::size_t i : intensities_)
      if (i < cells.size()) intensity_.push_back(intensity_of(number_in(cells[i])));
    if (intensity_.size() != range_mm_.size()) intensity_.clear();
    const double period_ns = 1e9 / table_.options.scan_hz.value_or(40);
    give_scan(table_, stamp.value_or(static_cast<double>(rows_ - 1) * period_ns), geometry, range_mm_,
              intensity_);
  }

  void end() override {
    if (!time_.present() && rows_ > 1) table_.invented_times();
    if (several_) table_.sink.note("The table holds several echoes a step: the first was used.");
    range_cells_.report(table_.sink, table_.decimal_comma);
    report_left_out(rows_);
  }

 private:
  /// Columns called ranges, or, where none is, all that are called nothing that rig knows. Of several with
  /// the same name (echoes of one step) the first.
  void choose_columns() {
    const auto& columns = table_.columns;
    const bool named = std::ranges::any_of(columns, [](const auto& c) { return c.holds == Holds::range; });
    std::size_t echoes = 1;
    for (std::size_t i = 0; i < columns.size(); ++i) {
      if (columns[i].holds == Holds::intensity) intensities_.push_back(i);
      if (columns[i].holds != (named ? Holds::range : Holds::unknown) || columns[i].name.empty()) continue;
      if (table_.with_header && !ranges_.empty() && columns[ranges_.back()].name == columns[i].name) {
        several_ = true;
        if (++echoes > most_echoes)
          table_.ask(
              "its header names more than " + std::to_string(most_echoes) + " columns '" + columns[i].name +
                  "' one after the other, which are too many for echoes of one step.",
              "Give --columns with NAME* for all that remain (--columns time_s,range_mm*), or number the "
              "names: range0_mm,range1_mm,...");
        continue;
      }
      echoes = 1;
      ranges_.push_back(i);
      units_known_ = units_known_ && columns[i].unit_known;
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

  Times time_;
  Lengths lengths_;
  RangeCells range_cells_;
  std::vector<std::size_t> ranges_, intensities_;
  bool several_ = false, units_known_ = true;
  std::optional<fit::ScanGeometry> geometry_;
  std::uint64_t rows_ = 0;
  std::vector<std::uint16_t> range_mm_, intensity_;
};

}  // namespace

std::unique_ptr<Rows> make_scan_rows(const Table& table) { return std::make_unique<ScanRows>(table); }

}  // namespace rig::table_rows
