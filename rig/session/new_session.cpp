// SPDX-License-Identifier: MIT
#include "rig/session/new_session.hpp"

#include <fcntl.h>
#include <stdio.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>

#include "rig/errors.hpp"
#include "rig/session/database_errors.hpp"
#include "rig/session/session_file.hpp"
#include "rig/whole_file.hpp"

namespace rig {
namespace {

namespace fs = std::filesystem;

void demand_free(const std::string& path) {
  std::error_code ignored;
  const bool empty_file = fs::is_regular_file(path, ignored) && !has_data(path);
  if (!empty_file && fs::exists(fs::symlink_status(path, ignored)) && !fs::is_directory(path, ignored))
    throw UsageError(path + " already exists and is not overwritten. Choose another name, or remove it.");
}

/// All that SQLite may have left of a database.
void remove_database(const std::string& path) {
  std::error_code ignored;
  for (const char* ending : {"", "-wal", "-shm", "-journal"}) fs::remove(path + ending, ignored);
}

/// Gives the file its name unless another has it. Returns 0 or the system's error number.
int take_name(const std::string& unfinished, const std::string& path) {
  const auto rename = [&](unsigned flags) {
    return ::renameat2(AT_FDCWD, unfinished.c_str(), AT_FDCWD, path.c_str(), flags) == 0 ? 0 : errno;
  };
  const int error = rename(RENAME_NOREPLACE);
  std::error_code ignored;
  const bool free = !fs::exists(fs::symlink_status(path, ignored));
  const bool empty_file = fs::is_regular_file(fs::symlink_status(path, ignored)) && !has_data(path);
  // Some file systems know no such flag; and an empty file is nothing to be kept.
  if ((error == EINVAL && free) || (error != 0 && empty_file)) return rename(0);
  return error;
}

}  // namespace

void make_session(const OutputPlace& place, const std::function<void(const std::string& unfinished)>& make) {
  const std::string& path = place.path();
  demand_free(path);
  const std::string unfinished = path + ".unfinished-" + std::to_string(::getpid());
  remove_database(unfinished);  // Of a program that was killed and had the same number.
  try {
    guarded(path, [&] { make(unfinished); });
    sync_file(unfinished);
  } catch (const SessionDiskError&) {  // Its words are for one who has something to resume.
    remove_database(unfinished);
    throw MeasurementError("cannot write " + path +
                           ": the disk is full or fails. Nothing is left of it. Free some space, or choose a "
                           "folder on another disk.");
  } catch (...) {
    remove_database(unfinished);
    throw;
  }
  if (const int error = take_name(unfinished, path); error != 0)
    throw UsageError(
        "cannot write " + path + ": " +
        (error == EEXIST ? "another file has appeared there meanwhile." : why_not_written(path, error)) +
        " The session is complete and is kept as " + unfinished + ": rename it.");
  sync_folder(path);
}

void copy_session(const std::string& from, const std::string& to) {
  const auto source = open_for_reading(from);
  SQLite::Statement copy(*source, "VACUUM INTO ?");
  copy.bind(1, to);
  copy.exec();
}

}  // namespace rig
