// SPDX-License-Identifier: MIT
// What a resumed run needs to know of the one before.
#include <stdexcept>

#include "rig/session/database_errors.hpp"
#include "rig/session/session_store_impl.hpp"

namespace rig {

void SessionStore::set_progress(const std::string& step, const std::string& json) {
  impl_->require_transaction();
  guarded(impl_->path, [&] {
    SQLite::Statement statement(*impl_->database, "INSERT OR REPLACE INTO progress VALUES(?, ?)");
    statement.bind(1, step);
    statement.bind(2, json);
    statement.exec();
  });
}

std::map<std::string, std::string> SessionStore::progress() const {
  return guarded(impl_->path, [&] {
    std::map<std::string, std::string> steps;
    if (!impl_->database->tableExists("progress")) return steps;
    SQLite::Statement row(*impl_->database, "SELECT step, json FROM progress");
    while (row.executeStep()) steps[row.getColumn(0).getString()] = row.getColumn(1).getString();
    return steps;
  });
}

void SessionStore::forget_progress(const std::vector<std::string>& steps,
                                   const std::vector<std::int64_t>& captures) {
  if (impl_->open_capture) throw std::logic_error("progress is not forgotten inside a capture");
  guarded(impl_->path, [&] {
    SQLite::Transaction transaction(*impl_->database, SQLite::TransactionBehavior::IMMEDIATE);
    SQLite::Statement forget(*impl_->database, "DELETE FROM progress WHERE step = ?");
    for (const auto& step : steps) {
      forget.reset();
      forget.bind(1, step);
      forget.exec();
    }
    for (const auto id : captures)
      impl_->execute("UPDATE capture SET step = step || ' (repeated)' WHERE id = ?", id);
    transaction.commit();
  });
}

void SessionStore::replace_capture(std::int64_t old_capture) {
  if (!impl_->open_capture || impl_->open_capture == old_capture)
    throw std::logic_error("only an open capture replaces another");
  guarded(impl_->path, [&] {
    impl_->execute("DELETE FROM scan_geometry WHERE capture = ?", old_capture);
    impl_->execute("DELETE FROM scan WHERE capture = ?", old_capture);
    impl_->execute("DELETE FROM capture WHERE id = ?", old_capture);
  });
}

}  // namespace rig
