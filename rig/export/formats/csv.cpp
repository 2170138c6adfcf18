// SPDX-License-Identifier: MIT
#include <charconv>
#include <cmath>
#include <cstdio>
#include <string>

#include "fit/numeric/angle.hpp"
#include "rig/errors.hpp"
#include "rig/export/exporter.hpp"
#include "rig/session/deskewed_scans.hpp"
#include "rig/whole_file.hpp"

namespace rig::exporters {
namespace {

/// A text file written in large pieces; any failure to write is reported at close().
class Output {
 public:
  explicit Output(const std::string& path) : file_(std::fopen(path.c_str(), "wb")) {
    if (!file_) throw UsageError("cannot write " + path + ": check the folder and the permission");
  }
  ~Output() {
    if (file_) std::fclose(file_);
  }
  Output(const Output&) = delete;
  Output& operator=(const Output&) = delete;

  void add(const std::string& text) {
    if (std::fwrite(text.data(), 1, text.size(), file_) != text.size()) failed();
  }
  void close() {
    std::FILE* file = file_;
    file_ = nullptr;
    if (std::fclose(file) != 0) failed();
  }

 private:
  [[noreturn]] static void failed() { throw DiskFailure("the table is cut"); }
  std::FILE* file_;
};

template <class T>
void append(std::string& out, T value) {
  char digits[32];
  const auto end = std::to_chars(digits, digits + sizeof digits, value);
  out.append(digits, end.ptr);
}

/// RFC 4180: text with a comma, a quote or a line end stands in quotes.
std::string quoted(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

/// One row for every value that was measured: what spreadsheets and data frames group as they like.
class Csv : public Exporter {
 public:
  std::string format() const override { return "csv"; }
  std::string describes() const override { return "one row for each measured value (large)"; }

  void write(const ExportSource& source, const std::string& output) const override {
    const auto recording = source.session->recording();
    Output out(output);
    const DeskewedSession corrected(*source.session);
    const bool deskewed = corrected.any();
    out.add(
        "capture,step,stage_deg,target,target_shift_mm,seq,device_ms,host_us,beam,beam_deg,range_mm,"
        "intensity");
    out.add(deskewed ? ",deskewed_x_mm,deskewed_y_mm,map_x_mm,map_y_mm\n" : "\n");
    std::string rows;
    for (std::size_t i = 0; i < recording->captures().size(); ++i) {
      const fit::CaptureInfo& capture = recording->captures()[i];
      const std::string head = head_of(capture);
      const auto straight = corrected.scans_of(capture.id);
      recording->for_each_scan(i, [&](const fit::ScanView& scan) {
        rows.clear();
        const DeskewedScan* points = straight ? straight->of(scan.seq) : nullptr;
        add_scan(rows, head, recording->bench().lidar, capture, scan, deskewed, points);
        out.add(rows);
      });
    }
    out.close();
  }

 private:
  static std::string head_of(const fit::CaptureInfo& capture) {
    std::string head;
    append(head, capture.id);
    head += ',' + quoted(capture.step) + ',';
    append(head, capture.stage_rad * fit::deg_per_rad);
    head += ',' + quoted(capture.target.value_or("")) + ',';
    append(head, capture.target_shift_mm);
    return head + ',';
  }

  static void add_scan(std::string& rows, const std::string& head, const fit::LidarGeometry& lidar,
                       const fit::CaptureInfo& capture, const fit::ScanView& scan, bool deskewed,
                       const DeskewedScan* points) {
    const fit::BeamAngles angles(lidar, capture, scan.geometry);
    for (std::size_t k = 0; k < scan.range_mm.size(); ++k) {
      const int beam = capture.first_step + static_cast<int>(k) * capture.cluster;
      rows += head;
      append(rows, scan.seq);
      rows += ',';
      append(rows, scan.device_ms);
      rows += ',';
      append(rows, scan.host_us);
      rows += ',';
      append(rows, beam);
      rows += ',';
      char digits[32];
      rows.append(digits, static_cast<std::size_t>(std::snprintf(digits, sizeof digits, "%.6g",
                                                                 angles.at_rad(k) * fit::deg_per_rad)));
      rows += ',';
      append(rows, scan.range_mm[k]);
      rows += ',';
      if (k < scan.intensity.size()) append(rows, scan.intensity[k]);
      if (deskewed) add_point(rows, points, k);
      rows += '\n';
    }
  }

  /// Where the point was in the lidar's frame when the scan began, and in the map; empty without echo.
  static void add_point(std::string& rows, const DeskewedScan* scan, std::size_t k) {
    const bool there = scan && 2 * k + 1 < scan->points.size() && !std::isnan(scan->points[2 * k]);
    if (!there) {
      rows += ",,,,";
      return;
    }
    const Eigen::Vector2d point(scan->points[2 * k], scan->points[2 * k + 1]);
    const Eigen::Vector2d in_map = scan->lidar * point;
    for (const double value : {point.x(), point.y(), in_map.x(), in_map.y()}) {
      char digits[32];
      rows += ',';
      rows.append(digits, static_cast<std::size_t>(std::snprintf(digits, sizeof digits, "%.2f", value)));
    }
  }
};

}  // namespace

std::unique_ptr<Exporter> make_csv() { return std::make_unique<Csv>(); }

}  // namespace rig::exporters
