// SPDX-License-Identifier: MIT
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "rig/errors.hpp"
#include "rig/session/session_store.hpp"

namespace rig::commands {

/// Refuses a recording that is given twice, by whatever name or as a copy: its samples would count twice, and
/// an uncertainty would be too small. Files that are not there are left to whoever reads them. Throws
/// UsageError.
inline void demand_different_sessions(const std::vector<std::string>& files) {
  for (std::size_t i = 0; i < files.size(); ++i)
    for (std::size_t j = 0; j < i; ++j) {
      std::error_code ignored;
      if (!std::filesystem::equivalent(files[i], files[j], ignored)) continue;
      throw UsageError(files[i] +
                       (files[i] == files[j] ? " is given twice" : " and " + files[j] + " are one file") +
                       ": what it holds would count twice. Name it once.");
    }
  if (files.size() < 2) return;
  std::map<std::string, std::string> by_content;
  for (const std::string& file : files) {
    std::error_code ignored;
    if (!std::filesystem::exists(file, ignored) || !is_session_file(file)) continue;
    const auto [same, is_new] =
        by_content.emplace(SessionStore(file, SessionStore::Mode::read).content_hash(), file);
    if (!is_new)
      throw UsageError(file + " holds the same recording as " + same->second +
                       ": it would count twice. Name one of them.");
  }
}

}  // namespace rig::commands
