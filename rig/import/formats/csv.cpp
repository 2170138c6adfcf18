// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <memory>

#include "rig/errors.hpp"
#include "rig/import/importer.hpp"
#include "rig/text_lines.hpp"

namespace rig::importers {
namespace {

/// Milliseconds, metres ... told by the end of a column's name.
double scale_to(const std::string& name, double none) {
  const auto ends = [&](const char* suffix) { return name.ends_with(suffix); };
  if (ends("_ns") || ends("(ns)") || ends("[ns]")) return 1;
  if (ends("_us") || ends("(us)") || ends("[us]")) return 1e3;
  if (ends("_ms") || ends("(ms)") || ends("[ms]")) return 1e6;
  if (ends("_s") || ends("(s)") || ends("[s]")) return 1e9;
  return none;
}

std::string lower(std::string_view text) {
  std::string out(trimmed(text));
  std::ranges::transform(out, out.begin(),
                         [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return out;
}

bool is_time(const std::string& name) {
  return name.starts_with("time") || name.starts_with("stamp") || name.starts_with("host_") ||
         name.starts_with("device_") || name == "t" || name.starts_with("t_");
}

char separator_of(std::string_view line) {
  char best = ',';
  for (const char c : {',', ';', '\t'})
    if (std::ranges::count(line, c) > std::ranges::count(line, best)) best = c;
  return best;
}

/// Tables of scans as CSV, in two shapes: one row a scan (all ranges side by side, perhaps after a time), as
/// UrgBenri and many scripts write it; or one row a value, with named columns, as `rig export` writes it.
class Reader {
 public:
  Reader(std::string path, const ImportOptions& options, ImportSink& sink)
      : path_(std::move(path)), options_(options), sink_(sink) {}

  void read(std::istream& in) {
    std::string line;
    bool too_long = false, first = true;
    while (sink_.wants_more() && next_line(in, line, too_long)) {
      if (trimmed(line).empty() || line.front() == '#') continue;
      if (first) separator_ = separator_of(line);
      const auto cells = split(line, separator_);
      if (first && !number_in(cells.front()))
        header(cells);
      else if (!first && columns_.size() > 1 && !number_in(cells.front()))
        second_header(cells);
      else if (by_value_)
        value_row(cells);
      else
        scan_row(cells);
      first = false;
    }
    if (too_long)
      throw UsageError(path_ +
                       " has a line of more than four million characters: it is not a table of scans.");
    if (by_value_) flush();
    if (!columns_.empty() || rows_ > 0) finish();
  }

 private:
  // --- header -------------------------------------------------------------------------------------------

  void header(const std::vector<std::string_view>& cells) {
    for (const auto& cell : cells) columns_.push_back(lower(cell));
    const auto find = [&](std::initializer_list<const char*> names) {
      for (const char* name : names)
        for (std::size_t i = 0; i < columns_.size(); ++i)
          if (columns_[i] == name) return static_cast<int>(i);
      return -1;
    };
    range_ = find({"range_mm", "distance_mm", "range_m", "distance_m", "range", "distance"});
    angle_ = find({"beam_deg", "angle_deg", "azimuth_deg", "angle_rad", "angle"});
    seq_ = find({"seq", "scan", "scan_id", "scan_seq"});
    capture_ = find({"capture"});
    intensity_column_ = find({"intensity", "level", "remission"});
    time_ = -1;
    for (std::size_t i = 0; i < columns_.size(); ++i)
      if (is_time(columns_[i]) && (time_ < 0 || columns_[i].starts_with("host_")))
        time_ = static_cast<int>(i);
    by_value_ = range_ >= 0 && angle_ >= 0 && seq_ >= 0;
    if (by_value_) {
      const std::string& range = columns_[static_cast<std::size_t>(range_)];
      const std::string& angle = columns_[static_cast<std::size_t>(angle_)];
      range_scale_ = range.ends_with("_m") ? 1000 : 1;
      angle_scale_ = angle.ends_with("rad") ? 1 : fit::rad_per_deg;
    } else {
      choose_columns();
    }
  }

  /// Of several columns with the same name (echoes of one step) the first; columns of time and number are not
  /// ranges.
  void choose_columns() {
    for (std::size_t i = 0; i < columns_.size(); ++i) {
      const std::string& name = columns_[i];
      if (is_time(name) || name.empty() || name == "seq" || name == "scan" || name == "index") continue;
      if (!wide_.empty() && columns_[wide_.back()] == name) {
        several_ = true;
        continue;
      }
      wide_.push_back(i);
    }
    wide_time_ = time_;
  }

  void second_header(const std::vector<std::string_view>& cells) {
    if (cells.size() > 1 && lower(cells[1]).starts_with("level"))
      throw UsageError(path_ + " holds intensities without ranges. Import the file with the ranges.");
  }

  // --- one row a scan -----------------------------------------------------------------------------------

  void scan_row(const std::vector<std::string_view>& cells) {
    if (wide_.empty()) {
      // Without a header: a first value too large for a range, or one more than the beams asked for, is a
      // time.
      const bool timed = cells.size() > 2 && number_in(cells[0]).value_or(0) >= 65536;
      wide_time_ = timed ? 0 : -1;
      for (std::size_t i = timed ? 1 : 0; i < cells.size(); ++i) wide_.push_back(i);
    }
    ++rows_;
    const auto widest = std::max(static_cast<std::ptrdiff_t>(wide_.back()), std::ptrdiff_t{wide_time_});
    if (std::ssize(cells) <= widest || wide_.size() > 100'000) {
      ++faulty_;
      return;
    }
    if (!geometry_) geometry_ = geometry_for(wide_.size());
    std::optional<double> time;
    if (wide_time_ >= 0) {
      time = number_in(cells[static_cast<std::size_t>(wide_time_)]);
      const std::string name =
          columns_.empty() ? "timestamp" : columns_[static_cast<std::size_t>(wide_time_)];
      if (time) *time *= scale_to(name, 1e6);
    }
    if (wide_time_ >= 0 && !time) {
      ++faulty_;
      return;
    }
    ranges_.clear();
    for (const std::size_t i : wide_) ranges_.push_back(range_of(number_in(cells[i])));
    const double period_ns = 1e9 / options_.scan_hz.value_or(40);
    give(time.value_or(static_cast<double>(rows_ - 1) * period_ns), {});
  }

  [[nodiscard]] fit::ScanGeometry geometry_for(std::size_t beams) {
    struct Known {
      std::size_t beams;
      double first_deg, step_deg, hz;
      const char* model;
    };
    constexpr Known known[] = {{1081, -135, 0.25, 40, "UST-10LX"},
                               {682, -119.53125, 0.3515625, 10, "URG-04LX"},
                               {726, -135, 0.3515625, 10, "URG-04LX"}};
    fit::ScanGeometry geometry;
    if (options_.first_deg && options_.step_deg && *options_.step_deg != 0) {
      geometry.first_rad = *options_.first_deg * fit::rad_per_deg;
      geometry.step_rad = *options_.step_deg * fit::rad_per_deg;
    } else {
      const auto model = std::ranges::find(known, beams, &Known::beams);
      if (model == std::end(known))
        throw UsageError(
            path_ + " has " + std::to_string(beams) +
            " values a scan and does not say how the beams lie. Give --first-deg and --step-deg.");
      geometry.first_rad = model->first_deg * fit::rad_per_deg;
      geometry.step_rad = model->step_deg * fit::rad_per_deg;
      if (!options_.scan_hz)
        geometry.scan_s = geometry.step_rad * static_cast<double>(beams) / (2 * fit::pi * model->hz);
      sink_.property("model", model->model);
      sink_.note(std::string("The beams were taken to lie as those of a ") + model->model +
                 ". Give --first-deg and --step-deg if that is wrong.");
    }
    if (options_.scan_hz)
      geometry.scan_s =
          std::abs(geometry.step_rad) * static_cast<double>(beams) / (2 * fit::pi * *options_.scan_hz);
    return geometry;
  }

  // --- one row a value ----------------------------------------------------------------------------------

  [[nodiscard]] static std::optional<double> cell(const std::vector<std::string_view>& cells, int column) {
    if (column < 0 || static_cast<std::size_t>(column) >= cells.size()) return std::nullopt;
    return number_in(cells[static_cast<std::size_t>(column)]);
  }

  void value_row(const std::vector<std::string_view>& cells) {
    ++rows_;
    const auto seq = cell(cells, seq_), angle = cell(cells, angle_), range = cell(cells, range_);
    if (!seq || !angle) {
      ++faulty_;
      return;
    }
    const double capture = cell(cells, capture_).value_or(0);
    if (!angles_.empty() && (*seq != scan_ || capture != scan_capture_)) flush();
    scan_ = *seq;
    scan_capture_ = capture;
    if (angles_.size() >= 100'000) return;
    if (angles_.empty()) stamp_ = cell(cells, time_);
    angles_.push_back(*angle * angle_scale_);
    ranges_.push_back(range_of(range ? std::optional(*range * range_scale_) : std::nullopt));
    if (intensity_column_ >= 0) intensities_.push_back(intensity_of(cell(cells, intensity_column_)));
  }

  void flush() {
    if (angles_.size() >= 2) {
      fit::ScanGeometry geometry;
      geometry.first_rad = angles_.front();
      geometry.step_rad = (angles_.back() - angles_.front()) / static_cast<double>(angles_.size() - 1);
      bool even = geometry.step_rad != 0;
      for (std::size_t i = 0; i < angles_.size(); ++i)
        even = even && std::abs(geometry.first_rad + geometry.step_rad * static_cast<double>(i) -
                                angles_[i]) < 0.25 * std::abs(geometry.step_rad);
      if (even) {
        if (options_.scan_hz)
          geometry.scan_s = std::abs(geometry.step_rad) * static_cast<double>(angles_.size()) /
                            (2 * fit::pi * *options_.scan_hz);
        geometry_ = geometry;
        const double scale = time_ >= 0 ? scale_to(columns_[static_cast<std::size_t>(time_)], 1e6) : 1e9;
        give(stamp_ ? *stamp_ * scale : scan_ * 1e9 / options_.scan_hz.value_or(40), intensities_);
      } else {
        ++faulty_;
      }
    } else if (!angles_.empty()) {
      ++faulty_;
    }
    angles_.clear(), ranges_.clear(), intensities_.clear();
  }

  // ------------------------------------------------------------------------------------------------------

  void give(double stamp_ns, std::span<const std::uint16_t> intensity) {
    ImportedScan out;
    out.stamp_ns = static_cast<std::int64_t>(std::clamp(stamp_ns, -9e18, 9e18));
    out.source = "CSV";
    out.frame = "lidar";
    out.geometry = *geometry_;
    out.range_mm = ranges_;
    out.intensity = intensity;
    sink_.scan(out);
  }

  void finish() {
    if (several_) sink_.note("The table holds several echoes a step: the first was taken.");
    if (faulty_ > 0) sink_.note(std::to_string(faulty_) + " rows or scans were cut or absurd and left out.");
  }

  std::string path_;
  const ImportOptions& options_;
  ImportSink& sink_;
  char separator_ = ',';
  std::vector<std::string> columns_;
  bool by_value_ = false, several_ = false;
  int range_ = -1, angle_ = -1, seq_ = -1, capture_ = -1, time_ = -1, intensity_column_ = -1, wide_time_ = -1;
  double range_scale_ = 1, angle_scale_ = 1, scan_ = 0, scan_capture_ = 0;
  std::optional<double> stamp_;
  std::vector<std::size_t> wide_;
  std::optional<fit::ScanGeometry> geometry_;
  std::uint64_t rows_ = 0, faulty_ = 0;
  std::vector<double> angles_;
  std::vector<std::uint16_t> ranges_, intensities_;
};

class Csv : public Importer {
 public:
  std::string name() const override { return "CSV table (one row a scan, or one row a value)"; }

  bool recognises(const std::string& path, std::span<const std::uint8_t> first_bytes) const override {
    const std::string_view text(reinterpret_cast<const char*>(first_bytes.data()), first_bytes.size());
    return (path.ends_with(".csv") || path.ends_with(".CSV") || path.ends_with(".tsv")) &&
           text.find('\0') == text.npos;
  }

  void read(const std::string& path, const ImportOptions& options, ImportSink& sink) const override {
    std::ifstream in(path, std::ios::binary);
    if (!in) throw UsageError(path + " cannot be opened. Check the name and the permissions.");
    Reader(path, options, sink).read(in);
  }
};

}  // namespace

std::unique_ptr<Importer> make_csv() { return std::make_unique<Csv>(); }

}  // namespace rig::importers
