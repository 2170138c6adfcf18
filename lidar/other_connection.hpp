// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace lidar {

/// A connection of this computer, as Linux lists it.
struct HostConnection {
  std::uint16_t local_port = 0;
  std::uint64_t inode = 0;  ///< By which the program that holds it is found.
};

/// The first established connection to that IPv4 address (in the host's byte order) and port in the text of
/// /proc/net/tcp, other than the one from `own_port`.
[[nodiscard]] std::optional<HostConnection> connection_in(std::string_view proc_net_tcp,
                                                          std::uint32_t address, std::uint16_t port,
                                                          std::uint16_t own_port);

/// The same of this computer now, in words: "process 1234, rig"; only a port where the program is another
/// user's. Empty when there is none, or no such list.
[[nodiscard]] std::string other_connection_to(std::uint32_t address, std::uint16_t port,
                                              std::uint16_t own_port);

}  // namespace lidar
