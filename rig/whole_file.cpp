// SPDX-License-Identifier: MIT
#include "rig/whole_file.hpp"

#include <cerrno>
#include <filesystem>
#include <fstream>

#include "rig/errors.hpp"
#include "rig/output_place.hpp"

namespace rig {

void write_beside(const std::string& path, const std::function<void(const std::string& part)>& write) {
  demand_plain_file(path);
  refuse_recording(path);
  const std::string place = end_of_link(path), part = part_of(place);
  std::error_code failed, ignored;
  try {
    write(part);
  } catch (...) {
    std::filesystem::remove(part, ignored);
    throw;
  }
  if (!std::filesystem::exists(part, ignored))
    throw UsageError("cannot write " + path +
                     ": the file that was prepared for it has disappeared. Try again.");
  std::filesystem::rename(part, place, failed);
  if (!failed) return;
  std::filesystem::remove(part, ignored);
  throw UsageError("cannot write " + path + ": " + why_not_written(path, failed.value()));
}

void write_file_atomically(const std::string& path, const std::string& text) {
  const auto write = [&](const std::string& to) {
    errno = 0;
    std::ofstream out(to, std::ios::binary);
    if (out) out << text;
    out.flush();
    if (!out) throw UsageError("cannot write " + path + ": " + why_not_written(path, errno ? errno : EIO));
  };
  if (is_no_plain_file(path))
    write(path);
  else
    write_beside(path, write);
}

}  // namespace rig
