// SPDX-License-Identifier: MIT
#include "rig/fitting/deskew_session.hpp"

#include <SQLiteCpp/SQLiteCpp.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "rig/errors.hpp"
#include "rig/session/session_store.hpp"

namespace rig {
namespace {

/// A whole copy of the session by SQLite itself, which also carries what another program knows of it.
void copy_session(const std::string& from, const std::string& to) {
  namespace fs = std::filesystem;
  if (fs::exists(to)) throw UsageError(to + " is there already. Choose another name, or remove it.");
  SQLite::Database source(from, SQLite::OPEN_READONLY, 5000);
  SQLite::Statement copy(source, "VACUUM INTO ?");
  copy.bind(1, to);
  copy.exec();
}

}  // namespace

nlohmann::json deskew_session(const std::string& input, const std::string& output,
                              const DeskewOptions& options) {
  nlohmann::json result;
  {
    const SessionStore session(input, SessionStore::Mode::read);
    const Deskewing deskewing(options, *session.recording(), input);
    result = deskewing.document();
    copy_session(input, output);
    deskewing.write(output);
  }
  SessionStore store(output, SessionStore::Mode::append);
  store.add_result("deskew", result.dump());
  store.finish();
  return result;
}

}  // namespace rig
