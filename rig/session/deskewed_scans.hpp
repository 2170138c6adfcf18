// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "fit/motion/pose2.hpp"
#include "rig/session/session_store.hpp"

namespace SQLite {
class Database;
}

namespace rig {

/// What `rig deskew` made of one scan (docs/method/moving.md).
struct DeskewedScan {
  std::int64_t seq = 0;
  fit::Pose2 lidar;  ///< In the map, when the scan began.
  std::vector<float>
      points;  ///< x and y in mm in the lidar's frame at that moment, beam by beam; NaN: no echo.
};

/// The deskewed scans of one capture, to be read beside its scans: both in order of seq.
class DeskewedScans {
 public:
  DeskewedScans(SQLite::Database& database, std::int64_t capture);
  ~DeskewedScans();
  DeskewedScans(const DeskewedScans&) = delete;
  DeskewedScans& operator=(const DeskewedScans&) = delete;

  /// That of the scan `seq`, which must be later than the one asked for before; null if it has none. Valid
  /// until the next call.
  [[nodiscard]] const DeskewedScan* of(std::int64_t seq);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// What `rig deskew` left in a session, if it made it.
class DeskewedSession {
 public:
  explicit DeskewedSession(const SessionStore& session);
  ~DeskewedSession();
  DeskewedSession(const DeskewedSession&) = delete;
  DeskewedSession& operator=(const DeskewedSession&) = delete;

  [[nodiscard]] bool any() const { return any_; }
  /// Null where there is nothing. Borrows this object.
  [[nodiscard]] std::unique_ptr<DeskewedScans> scans_of(std::int64_t capture) const;

 private:
  std::unique_ptr<SQLite::Database> database_;
  bool any_;
};

}  // namespace rig
