// SPDX-License-Identifier: MIT
// Results and events: what came out, and what happened meanwhile.
#include "rig/session/database_errors.hpp"
#include "rig/session/session_store_impl.hpp"
#include "rig/session/utc.hpp"

namespace rig {

void SessionStore::add_result(const std::string& kind, const std::string& json) {
  guarded(impl_->path, [&] {
    SQLite::Statement statement(*impl_->database, "INSERT INTO result VALUES(?, ?, ?)");
    statement.bind(1, kind);
    statement.bind(2, utc_text(std::time(nullptr)));
    statement.bind(3, json);
    statement.exec();
  });
}

std::optional<std::string> SessionStore::latest_result(const std::string& kind) const {
  return guarded(impl_->path, [&]() -> std::optional<std::string> {
    SQLite::Statement statement(*impl_->database,
                                "SELECT json FROM result WHERE kind = ? ORDER BY rowid DESC LIMIT 1");
    statement.bind(1, kind);
    if (!statement.executeStep()) return std::nullopt;
    return statement.getColumn(0).getString();
  });
}

std::vector<SessionStore::Result> SessionStore::latest_results() const {
  return guarded(impl_->path, [&] {
    std::vector<Result> newest;
    SQLite::Statement row(
        *impl_->database,
        "SELECT r.kind, r.created_utc, r.json FROM (SELECT min(rowid) AS first, max(rowid) AS last"
        " FROM result GROUP BY kind) k JOIN result r ON r.rowid = k.last ORDER BY k.first");
    while (row.executeStep())
      newest.push_back(
          {row.getColumn(0).getString(), row.getColumn(1).getString(), row.getColumn(2).getString()});
    return newest;
  });
}

void SessionStore::Impl::write_events() {
  for (; events_written < waiting_events.size(); ++events_written)
    write_event(waiting_events[events_written]);
}

void SessionStore::Impl::write_event(const Event& event) {
  SQLite::Statement statement(*database, "INSERT INTO event VALUES(?, ?, ?)");
  statement.bind(1, event.host_us);
  statement.bind(2, event.level);
  statement.bind(3, event.text);
  statement.exec();
}

void SessionStore::add_event(std::int64_t host_us, const std::string& level, const std::string& text) {
  if (impl_->open_capture) {
    impl_->waiting_events.push_back({host_us, level, text});
    return;
  }
  guarded(impl_->path, [&] { impl_->write_event({host_us, level, text}); });
}

std::vector<SessionStore::Event> SessionStore::events() const {
  return guarded(impl_->path, [&] {
    std::vector<Event> all;
    SQLite::Statement row(*impl_->database, "SELECT host_us, level, text FROM event ORDER BY rowid");
    while (row.executeStep())
      all.push_back(
          {row.getColumn(0).getInt64(), row.getColumn(1).getString(), row.getColumn(2).getString()});
    all.insert(all.end(), impl_->waiting_events.begin(), impl_->waiting_events.end());
    return all;
  });
}

}  // namespace rig
