// SPDX-License-Identifier: MIT
#pragma once

#include <cstdlib>
#include <string>
#include <vector>

#include "rig/archive/archive_index.hpp"
#include "rig/command.hpp"

namespace rig::commands {

/// The options `--archive FOLDER` and `--index LOCATION` of commands that read an archive.
class ArchiveOption {
 public:
  void declare(CLI::App& command, bool is_required = false) {
    if (const char* folder = std::getenv("RIG_ARCHIVE")) folder_ = folder;
    if (const char* index = std::getenv("RIG_ARCHIVE_INDEX")) index_ = index;
    auto* option = command.add_option("--archive", folder_,
                                      "Folder of the archive (rig archive add); default: $RIG_ARCHIVE");
    if (is_required && folder_.empty()) option->required();
    declare_index(command);
  }
  void declare_index(CLI::App& command) {
    if (const char* index = std::getenv("RIG_ARCHIVE_INDEX")) index_ = index;
    command.add_option("--index", index_,
                       "Index of the archive: a file (default: archive-index.sqlite in its folder) or "
                       "postgresql://USER@HOST/DATABASE; default: $RIG_ARCHIVE_INDEX");
  }
  [[nodiscard]] bool given() const { return !folder_.empty(); }
  [[nodiscard]] const std::string& folder() const { return folder_; }
  [[nodiscard]] std::string location(const std::string& folder) const {
    return index_location(folder, index_);
  }
  /// Every session of the archive, by serial number and date. Throws UsageError.
  [[nodiscard]] std::vector<SessionRecord> sessions() const {
    return ArchiveIndex(location(folder_), false).sessions();
  }

 private:
  std::string folder_, index_;
};

}  // namespace rig::commands
