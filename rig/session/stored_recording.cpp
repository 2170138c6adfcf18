// SPDX-License-Identifier: MIT
#include "rig/session/stored_recording.hpp"

#include <bit>
#include <cstring>

#include "rig/errors.hpp"
#include "rig/session/database_errors.hpp"
#include "rig/session/row_values.hpp"

namespace rig {
namespace {

constexpr int most_beams = 100'000;

fit::CaptureInfo read_capture(const SQLite::Statement& row, const std::string& path) {
  fit::CaptureInfo info;
  info.id = row.getColumn(0).getInt64();
  info.step = row.getColumn(1).getString();
  info.started_us = row.getColumn(2).getInt64();
  info.stage_rad = row.getColumn(3).getDouble() * fit::rad_per_deg;
  info.stage_readback_rad = optional_real(row, 4, fit::rad_per_deg);
  info.approach = row.getColumn(5).getInt();
  if (!row.getColumn(6).isNull()) info.target = row.getColumn(6).getString();
  info.target_shift_mm = row.getColumn(7).getDouble();
  info.reflectance = optional_real(row, 8);
  info.temperature_c = optional_real(row, 9);
  info.since_power_on_s = optional_real(row, 10);
  info.stage_rate_rad_s = row.getColumn(11).getDouble() * fit::rad_per_deg;
  info.first_step = row.getColumn(12).getInt();
  info.last_step = row.getColumn(13).getInt();
  info.cluster = row.getColumn(14).getInt();
  if (info.first_step < 0 || info.last_step < info.first_step || info.cluster < 1 ||
      info.last_step > most_beams)
    throw UsageError(path + ": capture " + std::to_string(info.id) + " has the impossible step range " +
                     std::to_string(info.first_step) + ".." + std::to_string(info.last_step) +
                     " in clusters of " + std::to_string(info.cluster) +
                     ". The file is damaged or was made by a faulty program.");
  return info;
}

/// Walks the scans of one capture, copying each blob once into a buffer that is aligned for its values.
class ScanReader {
 public:
  ScanReader(SQLite::Database& database, const std::string& path, const fit::CaptureInfo& info)
      : path_(path),
        info_(info),
        with_geometry_(has_geometry(database, info.id)),
        scans_(database, with_geometry_
                             ? "SELECT s.seq, s.device_ms, s.host_us, s.range_mm, s.intensity, g.first_deg,"
                               " g.step_deg, g.scan_s FROM scan s LEFT JOIN scan_geometry g"
                               " ON g.capture = s.capture AND g.seq = s.seq WHERE s.capture = ?"
                               " ORDER BY s.seq"
                             : "SELECT seq, device_ms, host_us, range_mm, intensity FROM scan"
                               " WHERE capture = ? ORDER BY seq") {
    scans_.bind(1, info.id);
  }

  void walk(const std::function<void(const fit::ScanView&)>& visit) {
    while (scans_.executeStep()) visit(view(info_));
  }

 private:
  fit::ScanView view(const fit::CaptureInfo& info) {
    fit::ScanView scan;
    scan.seq = scans_.getColumn(0).getInt64();
    scan.device_ms = scans_.getColumn(1).getInt64();
    scan.host_us = scans_.getColumn(2).getInt64();
    scan.range_mm = values_of(3, ranges_);
    scan.intensity = values_of(4, intensities_);
    if (with_geometry_ && !scans_.getColumn(5).isNull())
      scan.geometry =
          fit::ScanGeometry{scans_.getColumn(5).getDouble() * fit::rad_per_deg,
                            scans_.getColumn(6).getDouble() * fit::rad_per_deg, optional_real(scans_, 7)};
    const auto beams = static_cast<std::size_t>(info.beams());
    if (!scan.geometry && scan.range_mm.size() != beams) refuse(info, scan.seq, scan.range_mm.size(), beams);
    if (!scan.intensity.empty() && scan.intensity.size() != scan.range_mm.size())
      refuse(info, scan.seq, scan.intensity.size(), scan.range_mm.size());
    return scan;
  }

  /// Hardly any capture has: looking for it scan by scan would cost more than the scans themselves.
  static bool has_geometry(SQLite::Database& database, std::int64_t capture) {
    if (!database.tableExists("scan_geometry")) return false;
    SQLite::Statement any(database, "SELECT 1 FROM scan_geometry WHERE capture = ? LIMIT 1");
    any.bind(1, capture);
    return any.executeStep();
  }

  /// SQLite's own copy of the blob, where it can be read as it is.
  std::span<const std::uint16_t> values_of(int index, std::vector<std::uint16_t>& own) {
    const SQLite::Column column = scans_.getColumn(index);
    const void* bytes = column.getBlob();
    const auto size = static_cast<std::size_t>(column.getBytes()) / 2;
    const bool aligned = reinterpret_cast<std::uintptr_t>(bytes) % alignof(std::uint16_t) == 0;
    if (std::endian::native == std::endian::little && aligned)
      return {static_cast<const std::uint16_t*>(bytes), size};
    own.resize(size);
    if (size > 0) std::memcpy(own.data(), bytes, 2 * size);
    swap_if_big_endian(own);
    return own;
  }

  [[noreturn]] void refuse(const fit::CaptureInfo& info, std::int64_t seq, std::size_t got,
                           std::size_t wanted) const {
    throw UsageError(path_ + ": scan " + std::to_string(seq) + " of capture " + std::to_string(info.id) +
                     " holds " + std::to_string(got) + " values where " + std::to_string(wanted) +
                     " were expected. The file is damaged or was made by a faulty program.");
  }

  const std::string& path_;
  const fit::CaptureInfo& info_;
  bool with_geometry_;
  SQLite::Statement scans_;
  std::vector<std::uint16_t> ranges_, intensities_;  // where SQLite's copies cannot be used
};

std::vector<fit::TrackPose> read_track(SQLite::Database& database) {
  std::vector<fit::TrackPose> track;
  if (!database.tableExists("pose")) return track;
  SQLite::Statement row(
      database,
      "SELECT host_us, x_mm, y_mm, heading_deg, wheel_left_rad, wheel_right_rad, stage_deg FROM pose"
      " ORDER BY host_us, rowid");
  while (row.executeStep())
    track.push_back({row.getColumn(0).getInt64(), optional_real(row, 1), optional_real(row, 2),
                     optional_real(row, 3, fit::rad_per_deg), optional_real(row, 4), optional_real(row, 5),
                     optional_real(row, 6, fit::rad_per_deg)});
  return track;
}

class StoredRecording final : public fit::Recording {
 public:
  StoredRecording(SQLite::Database& database, std::string path, fit::Bench bench)
      : database_(database),
        path_(std::move(path)),
        bench_(std::move(bench)),
        captures_(read_captures(database_, path_)),
        track_(read_track(database_)) {}
  const fit::Bench& bench() const override { return bench_; }
  const std::vector<fit::CaptureInfo>& captures() const override { return captures_; }
  const std::vector<fit::TrackPose>& track() const override { return track_; }
  void for_each_scan(std::size_t index,
                     const std::function<void(const fit::ScanView&)>& visit) const override {
    guarded(path_, [&] { ScanReader(database_, path_, captures_.at(index)).walk(visit); });
  }

 private:
  SQLite::Database& database_;
  std::string path_;
  fit::Bench bench_;
  std::vector<fit::CaptureInfo> captures_;
  std::vector<fit::TrackPose> track_;
};

}  // namespace

void swap_if_big_endian(std::vector<std::uint16_t>& values) {
  if constexpr (std::endian::native == std::endian::big)
    for (auto& value : values) value = static_cast<std::uint16_t>(value >> 8 | value << 8);
}

std::vector<fit::CaptureInfo> read_captures(SQLite::Database& database, const std::string& path) {
  std::vector<fit::CaptureInfo> captures;
  SQLite::Statement row(database, select_captures);
  while (row.executeStep()) captures.push_back(read_capture(row, path));
  return captures;
}

std::unique_ptr<fit::Recording> make_stored_recording(SQLite::Database& database, std::string path,
                                                      fit::Bench bench) {
  return std::make_unique<StoredRecording>(database, std::move(path), std::move(bench));
}

void walk_scans(SQLite::Database& database, const std::string& path, std::int64_t capture,
                const std::function<void(const fit::ScanView&)>& visit) {
  std::string query = select_captures;
  query.replace(query.find(" ORDER BY"), std::string::npos, " WHERE id = ?");
  SQLite::Statement row(database, query);
  row.bind(1, capture);
  if (!row.executeStep()) throw MeasurementError(path + " has no capture " + std::to_string(capture) + ".");
  const fit::CaptureInfo info = read_capture(row, path);
  ScanReader(database, path, info).walk(visit);
}

}  // namespace rig
