// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "rig/archive/archive_index.hpp"

namespace rig {

/// What was found of one file of an archive.
struct ArchiveFinding {
  enum class What {
    good,        ///< As it was taken in, byte for byte.
    added,       ///< New in the index.
    updated,     ///< The same measurement; results were added to the session since, or beside it.
    moved,       ///< The same file under another path.
    copied,      ///< The same measurement as another file: it does not count twice.
    unfinished,  ///< Being written, or its run was killed: not taken in yet.
    unindexed,   ///< In the folder and not in the index.
    changed,     ///< What was measured is not what was taken in.
    damaged,     ///< It cannot be read as a session.
    missing,     ///< In the index and not in the folder.
  };
  What what;
  std::string path, says;
  [[nodiscard]] bool is_fault() const { return what >= What::changed; }
};
/// "added", "changed", ...
[[nodiscard]] const char* name_of(ArchiveFinding::What what);

/// Where `scripts/explain-archive` leaves its results: explanations of sessions that stay as they are.
[[nodiscard]] std::string explanation_beside(const std::string& folder, const std::string& content_sha256);

struct AddOptions {
  bool rebuild = false;         ///< Forget the index first and read every session.
  bool accept_changes = false;  ///< Take in what was changed, as it is now.
  bool forget_missing = false;
  int threads = 2;
};

/// Takes the folder's sessions into the index. Those whose size and date are as before are not read again.
/// Sessions are never written. Everything but what is good is reported, in the order of paths.
std::vector<ArchiveFinding> add_to_archive(const std::string& folder, ArchiveIndex& index,
                                           const AddOptions& options = {});

/// Compares every file with its hash in the index, reading all of it. Nothing is written anywhere.
std::vector<ArchiveFinding> verify_archive(const std::string& folder, ArchiveIndex& index, int threads = 2);

/// The sessions below a folder (`*.rig`), as paths from it, in order. Hidden folders and `results` are left
/// out, links to folders are not followed. Throws UsageError: there is no such folder.
[[nodiscard]] std::vector<std::string> session_files(const std::string& folder);

}  // namespace rig
