// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <stdexcept>
#include <string>

namespace sim {

/// Binds `acceptor` to `endpoint`, without listening yet. `whose` is said when that fails: "the lidar's".
/// Throws std::runtime_error.
inline void bind_port(boost::asio::ip::tcp::acceptor& acceptor,
                      const boost::asio::ip::tcp::endpoint& endpoint, const std::string& whose) {
  acceptor.open(endpoint.protocol());
  acceptor.set_option(boost::asio::socket_base::reuse_address(true));
  boost::system::error_code failed;
  acceptor.bind(endpoint, failed);
  if (!failed) return;
  throw std::runtime_error(whose + " port " + endpoint.address().to_string() + ":" +
                           std::to_string(endpoint.port()) + " cannot be opened (" + failed.message() + ")" +
                           (failed == boost::asio::error::address_in_use
                                ? ": another program, perhaps another simulator, holds it. End that one, or "
                                  "choose another port; 0 "
                                  "picks a free one"
                                : ": choose another address or port; port 0 picks a free one"));
}

}  // namespace sim
