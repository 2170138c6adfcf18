// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "fit/recording.hpp"

namespace rig {

/// A session file (`*.rig`, docs/reference/session.md): crash-safe, one SQLite database. Opening a file that
/// is not one, or one of a later version, throws UsageError saying what it is and what to do; a full or
/// failing disk throws MeasurementError. Whatever was committed before stays intact in either case.
///
///   SessionStore store("run.rig", SessionStore::Mode::create);
///   const auto id = store.begin_capture(info);
///   store.add_scan(id, scan);      // as often as needed
///   store.commit_capture(id);      // on the disk when this returns
class SessionStore {
 public:
  /// create: a new file, refused if one with data is there. append: an existing file, refused while another
  /// program writes it. read: never changes what is in it; works on read-only media and beside a writer. A
  /// session whose writer was killed is made one file again by whoever opens it first. peek: as read, but not
  /// a byte of the file or beside it changes; a session with a log beside it, which is being written or whose
  /// writer was killed, is refused, and so is a file that holds anything but plain tables under their names.
  enum class Mode { create, append, read, peek };

  SessionStore(const std::string& path, Mode mode);
  ~SessionStore();
  SessionStore(const SessionStore&) = delete;
  SessionStore& operator=(const SessionStore&) = delete;

  void set(const std::string& key, const std::string& value);
  [[nodiscard]] std::optional<std::string> get(const std::string& key) const;

  /// Starts a capture; its id is assigned and returned. Nothing is visible to readers before
  /// commit_capture(), and nothing remains of it after a crash. One capture at a time.
  std::int64_t begin_capture(const fit::CaptureInfo& info);
  void add_scan(std::int64_t capture, const fit::ScanView& scan);
  /// Makes the capture durable (synchronous to the disk) before it returns.
  void commit_capture(std::int64_t capture);
  /// Says of the open capture that it holds fewer scans than were asked for: its step's name gets " (short)".
  void mark_short(std::int64_t capture);
  /// Forgets a capture that was begun and not committed. After a commit that failed there is nothing to do.
  void abandon_capture(std::int64_t capture);

  /// Saves everything as `FILE.rig.rescued` and throws MeasurementError if another program removed or
  /// replaced the file meanwhile; once. commit_capture() does the same. Not while a capture is open.
  void demand_name();
  /// Ends writing: an open capture is forgotten, the file is one plain file, and under its name
  /// (demand_name()).
  void finish();

  /// What a resumed run needs to know of a step that is done (JSON). Between begin_capture and commit_capture
  /// it becomes durable together with the capture: either both are there or neither.
  void set_progress(const std::string& step, const std::string& json);
  [[nodiscard]] std::map<std::string, std::string> progress() const;
  /// Takes back that steps are done, so that they are measured again. Their captures stay, their steps' names
  /// get " (repeated)".
  void forget_progress(const std::vector<std::string>& steps, const std::vector<std::int64_t>& captures);
  /// Removes a committed capture that a full one replaces; between begin_capture and commit_capture of that
  /// one.
  void replace_capture(std::int64_t old_capture);
  /// The committed captures, in order.
  [[nodiscard]] std::vector<fit::CaptureInfo> captures() const;
  [[nodiscard]] std::int64_t count_captures() const;
  [[nodiscard]] std::int64_t count_scans() const;
  /// Walks the scans of one committed capture.
  void for_each_scan(std::int64_t capture, const std::function<void(const fit::ScanView&)>& visit) const;

  void add_pose(const fit::TrackPose& pose);
  void add_result(const std::string& kind, const std::string& json);
  [[nodiscard]] std::optional<std::string> latest_result(const std::string& kind) const;
  struct Result {
    std::string kind, created_utc, json;
  };
  /// The newest result of every kind, in the order in which the kinds first appeared.
  [[nodiscard]] std::vector<Result> latest_results() const;
  /// Events of a capture that is abandoned are kept.
  void add_event(std::int64_t host_us, const std::string& level, const std::string& text);

  struct Event {
    std::int64_t host_us;
    std::string level, text;
  };
  [[nodiscard]] std::vector<Event> events() const;

  /// The recording for analysis; shares the open database, which must outlive it. Captures are those
  /// committed when it is made. The bench is the session's own, or `bench` if given.
  [[nodiscard]] std::unique_ptr<fit::Recording> recording(const std::optional<fit::Bench>& bench = {}) const;
  /// SHA-256 (hex) of the bench, captures, scans and poses in order: what certificates print to name the
  /// data.
  [[nodiscard]] std::string content_hash() const;
  [[nodiscard]] const std::string& path() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Whether the file begins like a session, or is named like one. Throws UsageError when it cannot be opened.
[[nodiscard]] bool is_session_file(const std::string& path);

}  // namespace rig
