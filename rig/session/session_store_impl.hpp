// SPDX-License-Identifier: MIT
#pragma once

#include <SQLiteCpp/SQLiteCpp.h>

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "rig/session/session_file.hpp"
#include "rig/session/session_store.hpp"

namespace rig {

/// What the parts of the store share: the open database, the capture that is being written, and what waits
/// for its end. SessionStore itself is written part by part: session_store.cpp opens, closes and keeps keys,
/// session_captures.cpp writes captures, scans and poses, session_progress.cpp what a resumed run needs,
/// session_results.cpp results and events, content_hash.cpp the name of the data.
struct SessionStore::Impl {
  std::string path;
  Mode mode;
  // The lock goes last: closing any descriptor of the file drops SQLite's own locks on it.
  std::unique_ptr<WriterLock> lock;
  mutable std::unique_ptr<SQLite::Database> database;
  std::optional<SQLite::Statement> insert_scan, insert_geometry;
  std::optional<std::int64_t> open_capture;
  int open_capture_beams = 0;
  bool rescued = false;  // Once is enough: what follows is the end of the run.
  // What waits for the end of a capture, and how much of it the open transaction holds: until that is
  // committed, all of it may have to be written again.
  std::vector<fit::TrackPose> poses;
  std::vector<Event> waiting_events;
  std::map<std::string, std::string> waiting_keys;
  std::size_t poses_written = 0, events_written = 0;
  std::vector<std::uint16_t> swapped;

  Impl(std::string path, Mode mode);
  ~Impl();
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  [[nodiscard]] bool writes() const { return mode == Mode::create || mode == Mode::append; }

  // session_store.cpp
  void create();
  void append();
  /// Made under another name and renamed, so that a session that exists is whole whenever the power fails.
  void make_empty();
  void make_durable();
  /// After every capture the file itself holds it: who copies the file alone, while it is written, loses
  /// little.
  void empty_log();
  /// A finished session is one plain file, which other clients can read from read-only media too.
  void make_plain();
  /// A session that was removed or replaced while it is written goes on without a name and ends with this
  /// program: all of it is saved under another name, and the run stops.
  void demand_name();
  void execute(const char* statement, std::int64_t id);

  // session_captures.cpp
  std::int64_t begin(const fit::CaptureInfo& info);
  void add(const fit::ScanView& scan);
  void require_open(std::int64_t capture);
  /// A failing disk makes SQLite roll back by itself: what follows must not be written without the capture.
  void require_transaction();
  void rollback();
  void write_poses();
  /// All that waits, into the open transaction.
  void write_waiting();
  /// After its commit.
  void forget_written();
  /// Writes what waited for the end of a capture.
  void flush();

  // session_results.cpp
  void write_events();
  void write_event(const Event& event);
};

}  // namespace rig
