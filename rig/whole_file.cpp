// SPDX-License-Identifier: MIT
#include "rig/whole_file.hpp"

#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "rig/errors.hpp"

namespace rig {

bool is_no_plain_file(const std::string& path) {
  std::error_code ignored;
  const std::filesystem::file_status status = std::filesystem::status(path, ignored);
  return std::filesystem::exists(status) && !std::filesystem::is_regular_file(status);
}

void write_beside(const std::string& path, const std::function<void(const std::string& part)>& write) {
  if (is_no_plain_file(path))
    throw UsageError("cannot write " + path + ": it is no plain file. Give -o the name of a file.");
  const std::string part = path + ".part" + std::to_string(::getpid());
  std::error_code ignored;
  try {
    write(part);
    std::filesystem::rename(part, path);
  } catch (const std::filesystem::filesystem_error& error) {
    std::filesystem::remove(part, ignored);
    throw UsageError("cannot write " + path + ": " + error.code().message());
  } catch (...) {
    std::filesystem::remove(part, ignored);
    throw;
  }
}

void write_file_atomically(const std::string& path, const std::string& text) {
  const auto write = [&](const std::string& to) {
    std::ofstream out(to, std::ios::binary);
    out << text;
    out.flush();
    if (!out)
      throw UsageError("cannot write " + path + ": check that its folder exists, is writable and has room");
  };
  if (is_no_plain_file(path))
    write(path);
  else
    write_beside(path, write);
}

}  // namespace rig
