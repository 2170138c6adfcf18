// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/http/string_body.hpp>
#include <cstdint>
#include <string>
#include <string_view>

namespace rig {

/// Where a small web server listens, and who may speak to it.
struct WebAccess {
  std::string address = "127.0.0.1";
  std::uint16_t port = 0;  ///< 0: any free one.
  std::string token;       ///< Empty: none is asked for; only allowed on a loopback address.
};

using WebRequest = boost::beast::http::request<boost::beast::http::string_body>;

/// Opens the acceptor and returns its port. Throws UsageError that names `option` when the address cannot be
/// listened on, or is not loopback and there is no token.
std::uint16_t listen_on(boost::asio::ip::tcp::acceptor& acceptor, const WebAccess& access,
                        const std::string& option);

/// Loopback pages may be asked for by anyone on this computer, so Host must be a loopback name (against DNS
/// rebinding). With a token, the token decides. The request's origin is judged by who calls this.
[[nodiscard]] bool admits_host_and_token(const WebRequest& request, const WebAccess& access);

[[nodiscard]] bool is_loopback_name(std::string_view host);
/// "127.0.0.1:8080" without the port.
[[nodiscard]] std::string_view host_without_port(std::string_view host);

/// "SCHEME://ADDRESS:PORT/", with the token.
[[nodiscard]] std::string url_of(const std::string& scheme, const WebAccess& access, std::uint16_t port);

}  // namespace rig
