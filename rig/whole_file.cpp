// SPDX-License-Identifier: MIT
#include "rig/whole_file.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <system_error>

#include "rig/descriptor.hpp"
#include "rig/errors.hpp"
#include "rig/output_place.hpp"

namespace rig {
namespace {

void write_named(const std::string& path, const std::string& part,
                 const std::function<void(const std::string& part)>& write) {
  try {
    write(part);
  } catch (const std::system_error& failure) {
    throw UsageError("cannot write " + path + ": " + why_not_written(path, failure.code().value()));
  } catch (const DiskFailure& failure) {
    throw MeasurementError("cannot write " + path + ": " + failure.what() +
                           ". Is the disk full? Nothing is left of it. Free some space, or choose a folder "
                           "on another disk.");
  }
}

}  // namespace

void write_beside(const std::string& path, const std::function<void(const std::string& part)>& write) {
  demand_plain_file(path);
  refuse_recording(path);
  const std::string place = end_of_link(path), part = part_of(place);
  std::error_code failed, ignored;
  try {
    write_named(path, part, write);
    if (!std::filesystem::exists(part, ignored))
      throw UsageError("cannot write " + path +
                       ": the file that was prepared for it has disappeared. Try again.");
    refuse_other_kind(place, kind_of_file(part));
    sync_file(part);
  } catch (...) {
    std::filesystem::remove(part, ignored);
    throw;
  }
  std::filesystem::rename(part, place, failed);
  if (!failed) return sync_folder(place);
  std::filesystem::remove(part, ignored);
  throw UsageError("cannot write " + path + ": " + why_not_written(path, failed.value()));
}

void sync_file(const std::string& path) {
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!file || ::fsync(file.get()) != 0)
    throw MeasurementError("cannot write " + path + ": " + why_not_written(path, errno));
}

void sync_folder(const std::string& path) {
  const auto folder = std::filesystem::absolute(path).parent_path();
  const Descriptor opened(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (opened) ::fsync(opened.get());  // Some file systems know no such thing of a folder.
}

void write_text(const std::string& part, const std::string& text) {
  errno = 0;
  std::ofstream out(part, std::ios::binary);
  if (!out) throw std::system_error(errno ? errno : EIO, std::generic_category());
  out << text;
  out.flush();
  if (!out) throw DiskFailure(std::strerror(errno ? errno : EIO));
}

void write_file_atomically(const std::string& path, const std::string& text) {
  const auto write = [&](const std::string& to) { write_text(to, text); };
  is_no_plain_file(path) ? write_named(path, path, write) : write_beside(path, write);
}

}  // namespace rig
