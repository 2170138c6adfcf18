// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <boost/asio/awaitable.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <chrono>
#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <optional>
#include <string>

#include "rig/live/web_access.hpp"

namespace rig {

using WebResponse = boost::beast::http::response<boost::beast::http::string_body>;
using WebSocket = boost::beast::websocket::stream<boost::beast::tcp_stream>;

/// Most messages a second to one peer.
constexpr std::chrono::milliseconds web_message_spacing{50};

/// One connected browser or program.
struct WebPeer {
  explicit WebPeer(boost::beast::tcp_stream&& stream)
      : socket(std::move(stream)), wake(socket.get_executor()) {}
  WebPeer(const WebPeer&) = delete;
  WebPeer& operator=(const WebPeer&) = delete;
  virtual ~WebPeer() = default;
  WebSocket socket;
  boost::asio::steady_timer wake;  ///< Cancelled when there is something to send.
};

/// What the small web servers of a run share: they accept connections, judge requests, answer plain ones, and
/// keep web sockets, of which one that vanished or does not read is dropped. What is sent and what a message
/// means is the derived class's. It lives as long as one of its coroutines: make it with std::make_shared,
/// and stop() it.
class WebService : public std::enable_shared_from_this<WebService> {
 public:
  using Peer = std::shared_ptr<WebPeer>;
  struct Limits {
    std::size_t peers, message_bytes;
  };
  WebService(const boost::asio::any_io_executor& executor, WebAccess access, Limits limits)
      : executor_(executor), access_(std::move(access)), limits_(limits), acceptor_(executor) {}
  WebService(const WebService&) = delete;
  WebService& operator=(const WebService&) = delete;
  virtual ~WebService() = default;

  /// Throws UsageError as listen_on().
  void listen(const std::string& option);
  [[nodiscard]] std::uint16_t port() const { return port_; }
  [[nodiscard]] std::string url(const std::string& scheme) const { return url_of(scheme, access_, port_); }
  [[nodiscard]] bool stopped() const { return stopped_; }
  /// Waits until every peer has all, for at most a second, then stops and calls `done`.
  void finish(std::function<void()> done);
  /// Closes every connection.
  void stop();
  [[nodiscard]] const std::list<Peer>& peers() const { return peers_; }

 protected:
  /// Whether an origin, which only browsers send, may see what is served; `host` is the request's own.
  [[nodiscard]] virtual bool is_welcome(std::string_view origin, std::string_view host) const = 0;
  /// The answer to a request that is no web socket, or to one that is refused.
  [[nodiscard]] virtual WebResponse respond(const WebRequest& request) const = 0;
  /// The subprotocol that the request offers and the service speaks; empty: none is needed. Without a value
  /// the request is refused.
  [[nodiscard]] virtual std::optional<std::string> protocol_of(const WebRequest&) const { return ""; }
  [[nodiscard]] virtual Peer new_peer(boost::beast::tcp_stream&& stream) const = 0;
  /// Sends whatever the peer has not had, until the socket fails or the service stops.
  virtual boost::asio::awaitable<void> send(Peer peer) = 0;
  virtual void receive(WebPeer& peer, const std::string& message, bool is_text) = 0;
  [[nodiscard]] virtual bool has_all(const WebPeer& peer) const = 0;

  [[nodiscard]] bool admits(const WebRequest& request) const;
  /// One message, text or binary. False when the socket failed.
  boost::asio::awaitable<bool> write(WebPeer& peer, const std::string& message, bool is_text);
  /// Until it is woken, for at most so long.
  boost::asio::awaitable<void> wait_for_news(WebPeer& peer, std::chrono::milliseconds longest);
  boost::asio::awaitable<void> pause(std::chrono::milliseconds time);

 private:
  boost::asio::awaitable<void> accept_all();
  boost::asio::awaitable<void> serve(boost::asio::ip::tcp::socket socket);
  boost::asio::awaitable<void> serve_peer(Peer peer, WebRequest request, std::string protocol);
  boost::asio::awaitable<void> wait_until_all_have_all();

  boost::asio::any_io_executor executor_;
  WebAccess access_;
  Limits limits_;
  boost::asio::ip::tcp::acceptor acceptor_;
  std::uint16_t port_ = 0;
  std::list<Peer> peers_;
  bool stopped_ = false;
};

}  // namespace rig
