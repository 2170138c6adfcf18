// SPDX-License-Identifier: MIT
// Captures, their scans, and poses: how a session grows.
#include <sqlite3.h>

#include <bit>
#include <stdexcept>

#include "rig/errors.hpp"
#include "rig/session/database_errors.hpp"
#include "rig/session/row_values.hpp"
#include "rig/session/session_schema.hpp"
#include "rig/session/session_store_impl.hpp"
#include "rig/session/stored_recording.hpp"

namespace rig {
namespace {

constexpr std::size_t poses_per_transaction = 4096;

void bind_blob(SQLite::Statement& statement, int index, std::span<const std::uint16_t> values,
               std::vector<std::uint16_t>& swapped) {
  if constexpr (std::endian::native == std::endian::big) {
    swapped.assign(values.begin(), values.end());
    swap_if_big_endian(swapped);
    values = swapped;
  }
  // An empty blob needs a pointer all the same: a null one would be stored as NULL.
  static constexpr char nothing = 0;
  const void* bytes = values.empty() ? static_cast<const void*>(&nothing) : values.data();
  statement.bindNoCopy(index, bytes, static_cast<int>(values.size_bytes()));
}

void insert_pose(SQLite::Statement& insert, const fit::TrackPose& pose) {
  insert.reset();
  insert.bind(1, pose.host_us);
  bind_optional(insert, 2, pose.x_mm, as_is);
  bind_optional(insert, 3, pose.y_mm, as_is);
  bind_optional(insert, 4, pose.heading_rad, file_degrees);
  bind_optional(insert, 5, pose.wheel_left_rad, as_is);
  bind_optional(insert, 6, pose.wheel_right_rad, as_is);
  bind_optional(insert, 7, pose.stage_rad, file_degrees);
  insert.exec();
}

}  // namespace

std::int64_t SessionStore::Impl::begin(const fit::CaptureInfo& info) {
  flush();
  database->exec("BEGIN IMMEDIATE");
  try {
    SQLite::Statement insert(
        *database,
        "INSERT INTO capture(step, started_us, stage_deg, stage_readback_deg, approach, target,"
        " target_shift_mm, reflectance, temperature_c, since_power_on_s, stage_rate_deg_s,"
        " first_step, last_step, cluster) VALUES(?,?,?,?,?,?,?,?,?,?,?,?,?,?)");
    insert.bind(1, info.step);
    insert.bind(2, info.started_us);
    insert.bind(3, file_degrees(info.stage_rad));
    bind_optional(insert, 4, info.stage_readback_rad, file_degrees);
    insert.bind(5, info.approach);
    bind_optional(insert, 6, info.target, as_is);
    insert.bind(7, info.target_shift_mm);
    bind_optional(insert, 8, info.reflectance, as_is);
    bind_optional(insert, 9, info.temperature_c, as_is);
    bind_optional(insert, 10, info.since_power_on_s, as_is);
    insert.bind(11, file_degrees(info.stage_rate_rad_s));
    insert.bind(12, info.first_step);
    insert.bind(13, info.last_step);
    insert.bind(14, info.cluster);
    insert.exec();
  } catch (...) {
    rollback();
    throw;
  }
  open_capture = database->getLastInsertRowid();
  open_capture_beams = info.beams();
  if (!insert_scan) {
    insert_scan.emplace(*database, "INSERT INTO scan VALUES(?, ?, ?, ?, ?, ?)");
    insert_geometry.emplace(*database, "INSERT INTO scan_geometry VALUES(?, ?, ?, ?, ?)");
  }
  return *open_capture;
}

void SessionStore::Impl::add(const fit::ScanView& scan) {
  if (!scan.geometry && scan.range_mm.size() != static_cast<std::size_t>(open_capture_beams))
    throw std::logic_error("a scan of " + std::to_string(scan.range_mm.size()) + " values in a capture of " +
                           std::to_string(open_capture_beams));
  insert_scan->reset();
  insert_scan->bind(1, *open_capture);
  insert_scan->bind(2, scan.seq);
  insert_scan->bind(3, scan.device_ms);
  insert_scan->bind(4, scan.host_us);
  bind_blob(*insert_scan, 5, scan.range_mm, swapped);
  std::vector<std::uint16_t> swapped_intensity;
  if (scan.intensity.empty())
    insert_scan->bind(6);
  else
    bind_blob(*insert_scan, 6, scan.intensity, swapped_intensity);
  insert_scan->exec();
  if (!scan.geometry) return;
  insert_geometry->reset();
  insert_geometry->bind(1, *open_capture);
  insert_geometry->bind(2, scan.seq);
  insert_geometry->bind(3, file_degrees(scan.geometry->first_rad));
  insert_geometry->bind(4, file_degrees(scan.geometry->step_rad));
  bind_optional(*insert_geometry, 5, scan.geometry->scan_s, as_is);
  insert_geometry->exec();
}

void SessionStore::Impl::require_open(std::int64_t capture) {
  if (open_capture != capture) throw std::logic_error("capture " + std::to_string(capture) + " is not open");
  require_transaction();
}

void SessionStore::Impl::require_transaction() {
  if (!open_capture || sqlite3_get_autocommit(database->getHandle()) == 0) return;
  rollback();
  throw MeasurementError("The disk refused the capture that was being written to " + path +
                         ". What was captured before is intact. Free some space or check the disk, then "
                         "continue with rig resume.");
}

void SessionStore::Impl::rollback() {
  open_capture.reset();
  poses_written = events_written = 0;
  if (insert_scan) insert_scan->reset();
  if (insert_geometry) insert_geometry->reset();
  // A full disk makes SQLite roll back by itself; a second ROLLBACK would then be an error.
  if (sqlite3_get_autocommit(database->getHandle()) == 0) database->exec("ROLLBACK");
}

void SessionStore::Impl::write_poses() {
  if (poses_written == poses.size()) return;
  SQLite::Statement insert(*database, "INSERT INTO pose VALUES(?, ?, ?, ?, ?, ?, ?)");
  for (; poses_written < poses.size(); ++poses_written) insert_pose(insert, poses[poses_written]);
}

void SessionStore::Impl::write_waiting() {
  write_poses();
  write_events();
  for (const auto& [key, value] : waiting_keys) put_key(*database, key, value);
}

void SessionStore::Impl::forget_written() {
  poses.clear();
  waiting_events.clear();
  waiting_keys.clear();
  poses_written = events_written = 0;
}

void SessionStore::Impl::flush() {
  if (poses.empty() && waiting_events.empty() && waiting_keys.empty()) return;
  SQLite::Transaction transaction(*database, SQLite::TransactionBehavior::IMMEDIATE);
  try {
    write_waiting();
    transaction.commit();
  } catch (...) {
    poses_written = events_written = 0;
    throw;
  }
  forget_written();
}

std::int64_t SessionStore::begin_capture(const fit::CaptureInfo& info) {
  if (impl_->open_capture) throw std::logic_error("one capture at a time");
  return guarded(impl_->path, [&] { return impl_->begin(info); });
}

void SessionStore::add_scan(std::int64_t capture, const fit::ScanView& scan) {
  impl_->require_open(capture);
  guarded(impl_->path, [&] { impl_->add(scan); });
}

void SessionStore::commit_capture(std::int64_t capture) {
  impl_->require_open(capture);
  guarded(impl_->path, [&] {
    impl_->insert_scan->reset();
    impl_->insert_geometry->reset();
    try {
      impl_->write_waiting();
      impl_->database->exec("COMMIT");
    } catch (...) {
      impl_->rollback();
      throw;
    }
    impl_->open_capture.reset();
    impl_->forget_written();
    impl_->empty_log();
    impl_->demand_name();
  });
}

void SessionStore::abandon_capture(std::int64_t capture) {
  if (!impl_->open_capture) return;  // A commit that failed has given it up already.
  impl_->require_open(capture);
  guarded(impl_->path, [&] {
    impl_->rollback();
    impl_->flush();
  });
}

void SessionStore::mark_short(std::int64_t capture) {
  impl_->require_open(capture);
  guarded(impl_->path,
          [&] { impl_->execute("UPDATE capture SET step = step || ' (short)' WHERE id = ?", capture); });
}

void SessionStore::add_pose(const fit::TrackPose& pose) {
  impl_->poses.push_back(pose);
  if (impl_->poses.size() - impl_->poses_written < poses_per_transaction) return;
  guarded(impl_->path, [&] {
    if (impl_->open_capture)
      impl_->write_poses();
    else
      impl_->flush();
  });
}

std::vector<fit::CaptureInfo> SessionStore::captures() const {
  return guarded(impl_->path, [&] { return read_captures(*impl_->database, impl_->path); });
}

std::int64_t SessionStore::count_captures() const {
  return guarded(impl_->path,
                 [&] { return impl_->database->execAndGet("SELECT count(*) FROM capture").getInt64(); });
}

std::int64_t SessionStore::count_scans() const {
  return guarded(impl_->path,
                 [&] { return impl_->database->execAndGet("SELECT count(*) FROM scan").getInt64(); });
}

void SessionStore::for_each_scan(std::int64_t capture,
                                 const std::function<void(const fit::ScanView&)>& visit) const {
  guarded(impl_->path, [&] { walk_scans(*impl_->database, impl_->path, capture, visit); });
}

}  // namespace rig
