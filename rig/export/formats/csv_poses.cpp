// SPDX-License-Identifier: MIT
#include <charconv>
#include <string>

#include "fit/numeric/angle.hpp"
#include "rig/errors.hpp"
#include "rig/export/exporter.hpp"
#include "rig/whole_file.hpp"

namespace rig::exporters {
namespace {

void append_cell(std::string& row, std::optional<double> value) {
  if (!row.empty()) row += ',';
  if (!value) return;
  char digits[32];
  const auto end = std::to_chars(digits, digits + sizeof digits, *value);
  row.append(digits, end.ptr);
}

/// The carrier's track: odometry, wheels and stage as they were recorded, or the corrected path of a deskewed
/// session. What was not recorded is left empty.
class CsvPoses : public Exporter {
 public:
  std::string format() const override { return "csv-poses"; }
  std::string describes() const override {
    return "the track: one row for each pose, wheel or stage reading";
  }

  void write(const ExportSource& source, const std::string& output) const override {
    const auto recording = source.session->recording();
    if (recording->track().empty())
      throw MeasurementError(source.path + " holds no track: neither poses nor wheels were recorded.");
    std::string out = "host_us,x_mm,y_mm,heading_deg,wheel_left_rad,wheel_right_rad,stage_deg\n";
    const auto degrees = [](std::optional<double> rad) {
      return rad ? std::optional(*rad * fit::deg_per_rad) : rad;
    };
    for (const fit::TrackPose& at : recording->track()) {
      std::string row = std::to_string(at.host_us);
      for (const auto& value : {at.x_mm, at.y_mm, degrees(at.heading_rad), at.wheel_left_rad,
                                at.wheel_right_rad, degrees(at.stage_rad)})
        append_cell(row, value);
      out += row + '\n';
    }
    write_text(output, out);
  }
};

}  // namespace

std::unique_ptr<Exporter> make_csv_poses() { return std::make_unique<CsvPoses>(); }

}  // namespace rig::exporters
