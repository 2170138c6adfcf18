// SPDX-License-Identifier: MIT
#include "rig/live/web_access.hpp"

#include <algorithm>

#include "rig/errors.hpp"

namespace rig {
namespace {

namespace asio = boost::asio;

/// Compares without giving away by its duration where two secrets differ.
bool same_secret(std::string_view a, std::string_view b) {
  unsigned difference = a.size() == b.size() ? 0 : 1;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i)
    difference |= static_cast<unsigned char>(a[i]) ^ static_cast<unsigned char>(b[i]);
  return difference == 0;
}

std::string query_value(std::string_view target, std::string_view key) {
  const std::size_t question = target.find('?');
  if (question == std::string_view::npos) return "";
  std::string_view rest = target.substr(question + 1);
  while (!rest.empty()) {
    const std::string_view pair = rest.substr(0, rest.find('&'));
    if (pair.starts_with(key) && pair.size() > key.size() && pair[key.size()] == '=')
      return std::string(pair.substr(key.size() + 1));
    rest.remove_prefix(std::min(rest.size(), pair.size() + 1));
  }
  return "";
}

}  // namespace

std::string_view host_without_port(std::string_view host) {
  if (host.starts_with('[')) return host.substr(0, host.find(']') + 1);
  return host.substr(0, host.rfind(':'));
}

bool is_loopback_name(std::string_view host) {
  return host == "localhost" || host == "127.0.0.1" || host == "[::1]";
}

std::uint16_t listen_on(asio::ip::tcp::acceptor& acceptor, const WebAccess& access,
                        const std::string& option) {
  boost::system::error_code failed;
  const auto address = asio::ip::make_address(access.address, failed);
  if (failed)
    throw UsageError(option + ": '" + access.address +
                     "' is not an IP address; use 127.0.0.1 or the address of a network card.");
  if (!address.is_loopback() && access.token.empty())
    throw UsageError(option + " on " + access.address +
                     " would let the whole network stop the stage: give --live-token SECRET, or leave the "
                     "address at 127.0.0.1.");
  const asio::ip::tcp::endpoint endpoint(address, access.port);
  acceptor.open(endpoint.protocol(), failed);
  if (!failed) acceptor.set_option(asio::socket_base::reuse_address(true), failed);
  if (!failed) acceptor.bind(endpoint, failed);
  if (!failed) acceptor.listen(asio::socket_base::max_listen_connections, failed);
  if (failed)
    throw UsageError(option + " cannot use " + access.address + ":" + std::to_string(access.port) + " (" +
                     failed.message() + "). " +
                     (failed == boost::system::errc::address_not_available
                          ? "Give --live-listen an address of this computer."
                          : "Choose another port with " + option + " PORT."));
  return acceptor.local_endpoint().port();
}

bool admits_host_and_token(const WebRequest& request, const WebAccess& access) {
  const std::string host(request[boost::beast::http::field::host]);
  if (access.token.empty()) return is_loopback_name(host_without_port(host));
  return same_secret(query_value(std::string_view(request.target().data(), request.target().size()), "token"),
                     access.token);
}

std::string url_of(const std::string& scheme, const WebAccess& access, std::uint16_t port) {
  const std::string host =
      access.address.find(':') == std::string::npos ? access.address : "[" + access.address + "]";
  return scheme + "://" + host + ":" + std::to_string(port) + "/" +
         (access.token.empty() ? "" : "?token=" + access.token);
}

}  // namespace rig
