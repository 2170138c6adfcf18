// SPDX-License-Identifier: MIT
#include "rig/live/web_service.hpp"

#include <algorithm>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>

namespace rig {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using asio::awaitable;
using asio::redirect_error;
using asio::use_awaitable;
using namespace std::chrono_literals;

namespace {

constexpr auto request_limit = 10s;

}  // namespace

void WebService::listen(const std::string& option) {
  port_ = listen_on(acceptor_, access_, option);
  asio::co_spawn(executor_, accept_all(), asio::detached);
}

awaitable<void> WebService::accept_all() {
  const auto self = shared_from_this();
  while (!stopped_) {
    boost::system::error_code failed;
    auto socket = co_await acceptor_.async_accept(redirect_error(use_awaitable, failed));
    if (stopped_) break;
    if (failed) {  // out of descriptors, say: try again shortly instead of spinning
      co_await pause(100ms);
      continue;
    }
    asio::co_spawn(executor_, serve(std::move(socket)), [self](const std::exception_ptr&) {});
  }
}

/// An origin, where one is sent, must be welcome: a foreign page in a browser of this computer must neither
/// see nor press anything.
bool WebService::admits(const WebRequest& request) const {
  const auto origin = request.find(http::field::origin);
  const beast::string_view host = request[http::field::host];
  if (origin != request.end() &&
      !is_welcome({origin->value().data(), origin->value().size()}, {host.data(), host.size()}))
    return false;
  return admits_host_and_token(request, access_);
}

awaitable<void> WebService::serve(asio::ip::tcp::socket socket) {
  const auto self = shared_from_this();
  beast::tcp_stream stream(std::move(socket));
  beast::flat_buffer buffer;
  http::request_parser<http::string_body> parser;
  parser.body_limit(limits_.message_bytes);
  parser.header_limit(8192);
  stream.expires_after(request_limit);
  boost::system::error_code failed;
  co_await http::async_read(stream, buffer, parser, redirect_error(use_awaitable, failed));
  if (failed) co_return;
  WebRequest request = parser.release();
  if (websocket::is_upgrade(request) && admits(request) && peers_.size() < limits_.peers)
    if (std::optional<std::string> protocol = protocol_of(request)) {
      co_await serve_peer(new_peer(std::move(stream)), std::move(request), std::move(*protocol));
      co_return;
    }
  const WebResponse response = respond(request);
  stream.expires_after(request_limit);
  co_await http::async_write(stream, response, redirect_error(use_awaitable, failed));
  stream.socket().shutdown(asio::ip::tcp::socket::shutdown_send, failed);
}

awaitable<void> WebService::serve_peer(Peer peer, WebRequest request, std::string protocol) {
  const auto self = shared_from_this();
  beast::get_lowest_layer(peer->socket).expires_never();
  auto timeout = websocket::stream_base::timeout::suggested(beast::role_type::server);
  timeout.idle_timeout = 20s;  // with pings: one that vanished is noticed and dropped
  timeout.keep_alive_pings = true;
  peer->socket.set_option(timeout);
  const auto name_protocol = [protocol](websocket::response_type& response) {
    if (!protocol.empty()) response.set(http::field::sec_websocket_protocol, protocol);
  };
  peer->socket.set_option(websocket::stream_base::decorator(name_protocol));
  peer->socket.read_message_max(limits_.message_bytes);
  boost::system::error_code failed;
  co_await peer->socket.async_accept(request, redirect_error(use_awaitable, failed));
  if (failed || stopped_) co_return;
  peers_.push_back(peer);
  asio::co_spawn(executor_, send(peer), [self](const std::exception_ptr&) {});
  while (!stopped_) {
    beast::flat_buffer buffer;
    co_await peer->socket.async_read(buffer, redirect_error(use_awaitable, failed));
    if (failed) break;
    receive(*peer, beast::buffers_to_string(buffer.data()), peer->socket.got_text());
  }
  peers_.remove(peer);
  peer->wake.cancel();
}

awaitable<bool> WebService::write(WebPeer& peer, const std::string& message, bool is_text) {
  boost::system::error_code failed;
  peer.socket.text(is_text);
  co_await peer.socket.async_write(asio::buffer(message), redirect_error(use_awaitable, failed));
  co_return !failed;
}

awaitable<void> WebService::wait_for_news(WebPeer& peer, std::chrono::milliseconds longest) {
  boost::system::error_code woken;
  peer.wake.expires_after(longest);
  co_await peer.wake.async_wait(redirect_error(use_awaitable, woken));
}

awaitable<void> WebService::pause(std::chrono::milliseconds time) {
  boost::system::error_code ignored;
  asio::steady_timer timer(executor_, time);
  co_await timer.async_wait(redirect_error(use_awaitable, ignored));
}

awaitable<void> WebService::wait_until_all_have_all() {
  const auto self = shared_from_this();
  const auto limit = std::chrono::steady_clock::now() + 1s;
  const auto waits = [this](const Peer& peer) { return !has_all(*peer); };
  while (std::ranges::any_of(peers_, waits) && std::chrono::steady_clock::now() < limit) co_await pause(10ms);
  stop();
}

void WebService::finish(std::function<void()> done) {
  asio::co_spawn(executor_, wait_until_all_have_all(),
                 [done = std::move(done)](const std::exception_ptr&) { done(); });
}

void WebService::stop() {
  if (stopped_) return;
  stopped_ = true;
  boost::system::error_code ignored;
  acceptor_.close(ignored);
  for (const Peer& peer : peers_) {
    peer->wake.cancel();
    beast::get_lowest_layer(peer->socket).close();
  }
}

}  // namespace rig
