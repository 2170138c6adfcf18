// SPDX-License-Identifier: MIT
#include "rig/runner/endpoint.hpp"

#include <charconv>

#include "rig/errors.hpp"

namespace rig {
namespace {

std::uint16_t parse_port(const std::string& digits, const std::string& refusal) {
  unsigned port = 0;
  const char* end = digits.data() + digits.size();
  const auto [stop, error] = std::from_chars(digits.data(), end, port);
  if (error != std::errc() || stop != end || port == 0 || port > 65535) throw UsageError(refusal);
  return static_cast<std::uint16_t>(port);
}

}  // namespace

Endpoint parse_endpoint(const std::string& text, const std::string& what, std::uint16_t default_port) {
  const std::string refusal = what + " '" + text +
                              "' is not an address; write HOST:PORT, for example 192.168.0.10:" +
                              std::to_string(default_port > 0 ? default_port : 10940) + ".";
  std::string rest = text;
  if (const auto scheme = rest.find("://"); scheme != std::string::npos) {
    if (rest.substr(0, scheme) != "tcp") throw UsageError(refusal);
    rest.erase(0, scheme + 3);
  }
  Endpoint endpoint("", default_port);
  const bool bracketed = rest.starts_with('[');
  const auto bracket = rest.find(']');
  if (bracketed && bracket == std::string::npos) throw UsageError(refusal);
  const auto colon = rest.find(':', bracketed ? bracket : 0);
  endpoint.host = bracketed ? rest.substr(1, bracket - 1) : rest.substr(0, colon);
  if (colon != std::string::npos) endpoint.port = parse_port(rest.substr(colon + 1), refusal);
  if (endpoint.host.empty() || endpoint.port == 0 || endpoint.host.find('/') != std::string::npos)
    throw UsageError(refusal);
  return endpoint;
}

}  // namespace rig
