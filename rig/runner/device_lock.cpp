// SPDX-License-Identifier: MIT
#include "rig/runner/device_lock.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "rig/errors.hpp"
#include "rig/session/lidar_identity.hpp"
#include "rig/session/standing.hpp"

namespace rig {
namespace {

std::string locks_folder() {
  if (const char* given = std::getenv("RIG_LOCKS")) return given;
  std::error_code ignored;
  const std::filesystem::path system = "/run/lock";
  return ((::access(system.c_str(), W_OK) == 0 ? system : std::filesystem::temp_directory_path(ignored)) /
          "rig")
      .string();
}

/// A folder in which every user of the computer may lock, and nobody remove another's files.
void make_locks_folder(const std::string& folder) {
  if (::mkdir(folder.c_str(), 01777) == 0) ::chmod(folder.c_str(), 01777);
}

/// A name of letters, digits and dashes; what is left of an identity that is none of a file's stays distinct
/// by its code.
std::string file_name(const std::string& kind, const std::string& identity) {
  std::string name = kind + "-";
  for (const char c : identity.substr(0, 150)) {
    const auto code = static_cast<unsigned char>(c);
    if (std::isalnum(code) != 0 || c == '-' || c == '.')
      name += c;
    else
      name += "_" + std::to_string(code);
  }
  return name + ".lock";
}

/// A file that another user made in a shared folder is opened, not made: the system may forbid the second.
int open_lock(const std::string& path) {
  constexpr int how = O_RDWR | O_CLOEXEC | O_NOFOLLOW;
  const int known = ::open(path.c_str(), how);
  if (known >= 0 || errno != ENOENT) return known;
  const int made = ::open(path.c_str(), how | O_CREAT, 0666);
  if (made >= 0) ::fchmod(made, 0666);
  return made;
}

std::string text_in(int fd) {
  std::string text(300, '\0');
  const ssize_t got = ::pread(fd, text.data(), text.size(), 0);
  text.resize(got > 0 ? static_cast<std::size_t>(got) : 0);
  for (char& c : text)
    if (static_cast<unsigned char>(c) < 0x20) c = ' ';
  return text;
}

}  // namespace

DeviceLocks::DeviceLocks(std::string holder) : holder_(std::move(holder)) {}

DeviceLocks::~DeviceLocks() {
  for (const auto& [name, fd] : held_) ::close(fd);
}

void DeviceLocks::lock(const std::string& kind, const std::string& identity) {
  const std::string name = file_name(kind, identity);
  if (held_.contains(name)) return;
  const std::string folder = locks_folder();
  make_locks_folder(folder);
  const int fd = open_lock(folder + "/" + name);
  if (fd < 0) return;
  if (::flock(fd, LOCK_EX | LOCK_NB) != 0) {
    const bool is_held = errno == EWOULDBLOCK;
    const std::string holder = text_in(fd);
    ::close(fd);
    if (!is_held) return;
    throw DeviceError("The " + kind + " " + identity + " is in use by another program" +
                      (holder.empty() ? "" : " (" + holder + ")") +
                      ". Let that run end or stop it; a second bench needs a " + kind + " of its own.");
  }
  const std::string text = holder_ + ", process " + std::to_string(::getpid());
  if (::ftruncate(fd, 0) == 0) (void)!::pwrite(fd, text.data(), text.size(), 0);
  held_[name] = fd;
}

void DeviceLocks::lock_lidar(const nlohmann::json& answers) {
  const LidarIdentity who = lidar_in(answers);
  if (who.serial.empty() || says_simulated(answers.dump())) return;
  lock("lidar", who.name() + " " + who.serial);
}

void DeviceLocks::lock_stage(const std::string& model, const std::string& serial) {
  if (!serial.empty() && !says_simulated(model)) lock("stage", model + " " + serial);
}

}  // namespace rig
