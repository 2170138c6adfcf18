// SPDX-License-Identifier: MIT
#include "lidar/other_connection.hpp"

#include <bit>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace lidar {
namespace {

constexpr std::string_view established = "01";

/// "0100007F:2ABC": the address as it lies in memory, the port as a number.
bool ends_at(std::string_view text, std::uint32_t& address, std::uint16_t& port) {
  if (text.size() != 13 || text[8] != ':') return false;
  const auto read = [&](std::size_t from, std::size_t count, auto& value) {
    const char* end = text.data() + from + count;
    return std::from_chars(text.data() + from, end, value, 16).ptr == end;
  };
  std::uint32_t stored = 0;
  if (!read(0, 8, stored) || !read(9, 4, port)) return false;
  address = stored;
  if constexpr (std::endian::native == std::endian::little)
    address = (stored >> 24) | ((stored >> 8) & 0xFF00) | ((stored << 8) & 0xFF0000) | (stored << 24);
  return true;
}

std::string first_line_of(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  return line;
}

/// "process 1234, rig": who has the socket open; empty where it may not be seen.
std::string holder_of(std::uint64_t inode) {
  namespace fs = std::filesystem;
  const std::string wanted = "socket:[" + std::to_string(inode) + "]";
  std::error_code failed;
  for (fs::directory_iterator process("/proc", failed), end; !failed && process != end;
       process.increment(failed)) {
    const std::string id = process->path().filename().string();
    if (id.empty() || id.find_first_not_of("0123456789") != std::string::npos) continue;
    std::error_code hidden;
    for (fs::directory_iterator open(process->path() / "fd", hidden); !hidden && open != end;
         open.increment(hidden)) {
      std::error_code gone;
      if (fs::read_symlink(open->path(), gone) == wanted)
        return "process " + id + ", " + first_line_of(process->path() / "comm");
    }
  }
  return "";
}

}  // namespace

std::optional<HostConnection> connection_in(std::string_view proc_net_tcp, std::uint32_t address,
                                            std::uint16_t port, std::uint16_t own_port) {
  std::istringstream lines{std::string(proc_net_tcp)};
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string number, local, remote, state, skipped;
    HostConnection found;
    words >> number >> local >> remote >> state;
    for (int i = 0; i < 5; ++i) words >> skipped;  // queues, timer, retransmissions, user, timeout
    std::uint32_t here = 0, there = 0;
    std::uint16_t there_port = 0;
    if (!(words >> found.inode) || state != established || !ends_at(local, here, found.local_port) ||
        !ends_at(remote, there, there_port))
      continue;
    if (there == address && there_port == port && found.local_port != own_port) return found;
  }
  return std::nullopt;
}

std::string other_connection_to(std::uint32_t address, std::uint16_t port, std::uint16_t own_port) {
  std::ifstream in("/proc/net/tcp");
  std::stringstream text;
  text << in.rdbuf();
  const auto found = connection_in(text.str(), address, port, own_port);
  if (!found) return "";
  const std::string holder = holder_of(found->inode);
  return holder.empty() ? "its local port is " + std::to_string(found->local_port) : holder;
}

}  // namespace lidar
