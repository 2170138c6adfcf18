// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <string>

namespace rig {

/// A TCP address as the operator writes it.
struct Endpoint {
  Endpoint() {}
  Endpoint(std::string host_, std::uint16_t port_) : host(std::move(host_)), port(port_) {}
  std::string host;
  std::uint16_t port = 0;
};

/// Reads "tcp://HOST:PORT", "HOST:PORT", "HOST" or "[::1]:PORT". `what` names the address in messages; a port
/// of 0 as `default_port` means that one must be given. Throws UsageError.
Endpoint parse_endpoint(const std::string& text, const std::string& what, std::uint16_t default_port);

}  // namespace rig
