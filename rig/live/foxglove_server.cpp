// SPDX-License-Identifier: MIT
#include "rig/live/foxglove_server.hpp"

#include <algorithm>
#include <array>
#include <boost/asio/awaitable.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <deque>
#include <list>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "rig/json_fields.hpp"
#include "rig/live/foxglove_messages.hpp"

namespace rig {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using nlohmann::json;

constexpr std::array<const char*, 2> foxglove_protocols{"foxglove.websocket.v1", "foxglove.sdk.v1"};
constexpr std::size_t most_clients = 16, most_subscriptions = 100, longest_log = 100;
constexpr std::size_t largest_client_message = 1 << 16;
constexpr std::chrono::milliseconds message_spacing{50};
constexpr std::chrono::seconds handshake_limit{10};

/// One message of a channel, with its place in the order of all.
struct StoredMessage {
  std::uint64_t number;
  std::int64_t time_ns;
  std::string body;
};

/// opcode 1, subscription, time, message (spec: "Message Data").
std::string frame_of(std::uint32_t subscription, const StoredMessage& message) {
  std::string frame(1, '\x01');
  for (int i = 0; i < 4; ++i) frame += static_cast<char>(subscription >> (8 * i));
  for (int i = 0; i < 8; ++i)
    frame += static_cast<char>(static_cast<std::uint64_t>(message.time_ns) >> (8 * i));
  return frame + message.body;
}

std::string offered_protocol(const WebRequest& request) {
  http::token_list offered(request[http::field::sec_websocket_protocol]);
  for (const char* known : foxglove_protocols)
    if (offered.exists(known)) return known;
  return "";
}

/// Foxglove's own site, pages of this computer, and desktop programs, which send no origin or one without a
/// host.
bool is_welcome_origin(std::string_view origin) {
  for (const std::string_view scheme : {"http://", "https://"}) {
    if (!origin.starts_with(scheme)) continue;
    const std::string_view host = host_without_port(origin.substr(scheme.size()));
    const std::string_view plain = host.empty() ? origin.substr(scheme.size()) : host;
    return is_loopback_name(plain) ||
           (scheme == "https://" && (plain == "app.foxglove.dev" || plain == "studio.foxglove.dev"));
  }
  return true;
}

}  // namespace

struct FoxgloveServer::Impl : std::enable_shared_from_this<FoxgloveServer::Impl> {
  struct Client {
    Client(beast::tcp_stream&& stream, const asio::any_io_executor& executor)
        : socket(std::move(stream)), wake(executor) {}
    struct Subscription {
      std::size_t channel;
      std::uint64_t sent = 0;  ///< Number of the last message.
    };
    websocket::stream<beast::tcp_stream> socket;
    asio::steady_timer wake;
    std::map<std::uint32_t, Subscription> subscriptions;
    std::deque<std::string> texts;  ///< To be sent before anything else.
    bool idle = false;
  };

  Impl(const asio::any_io_executor& executor_, WebAccess access_, const fit::Mount& lidar_)
      : executor(executor_), access(std::move(access_)), lidar(lidar_), acceptor(executor_) {
    channels.resize(foxglove_channels().size());
  }

  asio::any_io_executor executor;
  WebAccess access;
  fit::Mount lidar;
  asio::ip::tcp::acceptor acceptor;
  std::uint16_t port = 0;
  std::list<std::shared_ptr<Client>> clients;
  std::vector<std::deque<StoredMessage>> channels;
  std::uint64_t numbers = 0, logged = 0;
  bool stopped = false;

  asio::awaitable<void> accept_clients();
  asio::awaitable<void> serve(asio::ip::tcp::socket socket);
  asio::awaitable<void> serve_client(beast::tcp_stream stream, WebRequest request, std::string protocol);
  asio::awaitable<void> refuse(beast::tcp_stream stream, WebRequest request);
  asio::awaitable<void> send_messages(std::shared_ptr<Client> client);
  asio::awaitable<void> receive(std::shared_ptr<Client> client);
  asio::awaitable<void> send_last();
  void publish(const json& state, std::int64_t time_ns);
  void obey(Client& client, const std::string& text) const;
  void stop();
  [[nodiscard]] bool admits(const WebRequest& request) const;
  [[nodiscard]] std::deque<std::string> greeting() const;
  [[nodiscard]] std::optional<std::string> next_frame(Client& client) const;
};

asio::awaitable<void> FoxgloveServer::Impl::accept_clients() {
  const auto self = shared_from_this();
  while (!stopped) {
    boost::system::error_code failed;
    auto socket = co_await acceptor.async_accept(asio::redirect_error(asio::use_awaitable, failed));
    if (stopped) break;
    if (failed) {  // out of descriptors, say: try again shortly instead of spinning
      asio::steady_timer pause(executor, std::chrono::milliseconds(100));
      co_await pause.async_wait(asio::redirect_error(asio::use_awaitable, failed));
      continue;
    }
    auto serving = serve(std::move(socket));
    asio::co_spawn(executor, std::move(serving), [self](const std::exception_ptr&) {});
  }
}

bool FoxgloveServer::Impl::admits(const WebRequest& request) const {
  const auto origin = request.find(http::field::origin);
  if (origin != request.end() &&
      !is_welcome_origin(std::string_view(origin->value().data(), origin->value().size())))
    return false;
  return admits_host_and_token(request, access);
}

asio::awaitable<void> FoxgloveServer::Impl::serve(asio::ip::tcp::socket socket) {
  const auto self = shared_from_this();
  beast::tcp_stream stream(std::move(socket));
  beast::flat_buffer buffer;
  http::request_parser<http::string_body> parser;
  parser.body_limit(largest_client_message);
  parser.header_limit(8192);
  stream.expires_after(handshake_limit);
  boost::system::error_code failed;
  co_await http::async_read(stream, buffer, parser, asio::redirect_error(asio::use_awaitable, failed));
  if (failed) co_return;
  WebRequest request = parser.release();
  std::string protocol = offered_protocol(request);
  const bool welcome =
      websocket::is_upgrade(request) && !protocol.empty() && admits(request) && clients.size() < most_clients;
  auto answering = welcome ? serve_client(std::move(stream), std::move(request), std::move(protocol))
                           : refuse(std::move(stream), std::move(request));
  co_await std::move(answering);
}

asio::awaitable<void> FoxgloveServer::Impl::refuse(beast::tcp_stream stream, WebRequest request) {
  const bool allowed = admits(request);
  http::response<http::string_body> response{allowed ? http::status::bad_request : http::status::forbidden,
                                             request.version()};
  response.set(http::field::content_type, "text/plain; charset=utf-8");
  response.body() = allowed ? "This is a run's data for Foxglove: open " + url_of("ws", access, port) +
                                  " there, as a Foxglove WebSocket connection.\n"
                            : "Refused: use the exact address that rig printed, with its token.\n";
  response.keep_alive(false);
  response.prepare_payload();
  stream.expires_after(handshake_limit);
  boost::system::error_code failed;
  co_await http::async_write(stream, response, asio::redirect_error(asio::use_awaitable, failed));
  stream.socket().shutdown(asio::ip::tcp::socket::shutdown_send, failed);
}

std::deque<std::string> FoxgloveServer::Impl::greeting() const {
  json advertised = json::array();
  for (std::size_t i = 0; i < foxglove_channels().size(); ++i) {
    const FoxgloveChannel& channel = foxglove_channels()[i];
    advertised.push_back({{"id", i + 1},
                          {"topic", channel.topic},
                          {"encoding", "json"},
                          {"schemaName", channel.schema_name},
                          {"schema", channel.schema.dump()},
                          {"schemaEncoding", "jsonschema"}});
  }
  const json info = {{"op", "serverInfo"},
                     {"name", "rig " RIG_VERSION},
                     {"capabilities", json::array()},
                     {"supportedEncodings", json::array({"json"})},
                     {"metadata", json::object()}};
  return {info.dump(), json{{"op", "advertise"}, {"channels", advertised}}.dump()};
}

asio::awaitable<void> FoxgloveServer::Impl::serve_client(beast::tcp_stream stream, WebRequest request,
                                                         std::string protocol) {
  const auto self = shared_from_this();
  const auto client = std::make_shared<Client>(std::move(stream), executor);
  beast::get_lowest_layer(client->socket).expires_never();
  auto timeout = websocket::stream_base::timeout::suggested(beast::role_type::server);
  timeout.idle_timeout =
      std::chrono::seconds(20);  // with pings: a client that vanished is noticed and dropped
  timeout.keep_alive_pings = true;
  client->socket.set_option(timeout);
  client->socket.set_option(websocket::stream_base::decorator([protocol](websocket::response_type& response) {
    response.set(http::field::sec_websocket_protocol, protocol);
  }));
  client->socket.read_message_max(largest_client_message);
  boost::system::error_code failed;
  co_await client->socket.async_accept(request, asio::redirect_error(asio::use_awaitable, failed));
  if (failed || stopped) co_return;
  client->texts = greeting();
  clients.push_back(client);
  auto sending = send_messages(client);
  asio::co_spawn(executor, std::move(sending), asio::detached);
  auto receiving = receive(client);
  co_await std::move(receiving);
  clients.remove(client);
  client->wake.cancel();
}

/// The next message that a client has not had, subscription by subscription.
std::optional<std::string> FoxgloveServer::Impl::next_frame(Client& client) const {
  for (auto& [id, subscription] : client.subscriptions)
    for (const StoredMessage& message : channels[subscription.channel]) {
      if (message.number <= subscription.sent) continue;
      subscription.sent = message.number;
      return frame_of(id, message);
    }
  return std::nullopt;
}

asio::awaitable<void> FoxgloveServer::Impl::send_messages(std::shared_ptr<Client> client) {
  const auto self = shared_from_this();
  boost::system::error_code failed;
  while (!stopped && client->socket.is_open()) {
    bool sent = false;
    while (!client->texts.empty() && !failed) {
      const std::string text = client->texts.front();
      client->texts.pop_front();
      client->socket.text(true);
      co_await client->socket.async_write(asio::buffer(text),
                                          asio::redirect_error(asio::use_awaitable, failed));
    }
    while (!failed && client->texts.empty()) {
      const auto frame = next_frame(*client);
      if (!frame) break;
      client->socket.binary(true);
      co_await client->socket.async_write(asio::buffer(*frame),
                                          asio::redirect_error(asio::use_awaitable, failed));
      sent = true;
    }
    if (failed) co_return;
    if (!client->texts.empty()) continue;
    client->idle = !sent;
    client->wake.expires_after(sent ? std::chrono::milliseconds(message_spacing)
                                    : std::chrono::milliseconds(5000));
    boost::system::error_code woken;
    co_await client->wake.async_wait(asio::redirect_error(asio::use_awaitable, woken));
    client->idle = false;
  }
}

asio::awaitable<void> FoxgloveServer::Impl::receive(std::shared_ptr<Client> client) {
  const auto self = shared_from_this();
  boost::system::error_code failed;
  while (!stopped) {
    beast::flat_buffer buffer;
    co_await client->socket.async_read(buffer, asio::redirect_error(asio::use_awaitable, failed));
    if (failed) co_return;
    if (client->socket.got_text()) obey(*client, beast::buffers_to_string(buffer.data()));
    client->wake.cancel();
  }
}

void FoxgloveServer::Impl::obey(Client& client, const std::string& text) const {
  const json message = json::parse(text, nullptr, false);
  const std::string op = text_of(message, "op");
  const auto number_in_range = [](const json& value, std::uint64_t most) {
    return value.is_number_unsigned() && value.get<std::uint64_t>() <= most;
  };
  if (op == "subscribe") {
    for (const json& asked : list_of(message, "subscriptions")) {
      const json id = asked.is_object() ? asked.value("id", json()) : json();
      const json channel = asked.is_object() ? asked.value("channelId", json()) : json();
      if (!number_in_range(id, 0xFFFFFFFF) || !number_in_range(channel, channels.size()) || channel == 0 ||
          client.subscriptions.size() >= most_subscriptions)
        continue;
      client.subscriptions[id.get<std::uint32_t>()] = {channel.get<std::size_t>() - 1};
    }
    return;
  }
  if (op == "unsubscribe") {
    for (const json& id : list_of(message, "subscriptionIds"))
      if (number_in_range(id, 0xFFFFFFFF)) client.subscriptions.erase(id.get<std::uint32_t>());
    return;
  }
  if (client.texts.size() < 10)
    client.texts.push_back(json{{"op", "status"},
                                {"level", 1},
                                {"message", "a run is read only: '" + op.substr(0, 60) + "' is not served"}}
                               .dump(-1, ' ', false, json::error_handler_t::replace));
}

void FoxgloveServer::Impl::publish(const json& state, std::int64_t time_ns) {
  for (const FoxgloveMessage& message : foxglove_messages(state, time_ns, lidar, logged)) {
    auto& stored = channels[message.channel];
    const std::size_t keep = foxglove_channels()[message.channel].all ? longest_log : 1;
    while (stored.size() >= keep) stored.pop_front();
    stored.push_back({++numbers, time_ns, message.body.dump(-1, ' ', false, json::error_handler_t::replace)});
  }
  logged = static_cast<std::uint64_t>(
      number_of(state, "messages_total", static_cast<double>(list_of(state, "messages").size())));
  for (const auto& client : clients) {
    if (client->idle) client->wake.cancel();
    client->idle = false;  // It has something to get, which finish() waits for.
  }
}

asio::awaitable<void> FoxgloveServer::Impl::send_last() {
  const auto self = shared_from_this();
  const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(1);
  const auto waits = [](const std::shared_ptr<Client>& client) { return !client->idle; };
  while (std::ranges::any_of(clients, waits) && std::chrono::steady_clock::now() < limit) {
    asio::steady_timer pause(executor, std::chrono::milliseconds(10));
    boost::system::error_code failed;
    co_await pause.async_wait(asio::redirect_error(asio::use_awaitable, failed));
  }
  stop();
}

void FoxgloveServer::Impl::stop() {
  if (stopped) return;
  stopped = true;
  boost::system::error_code ignored;
  acceptor.close(ignored);
  for (const auto& client : clients) {
    client->wake.cancel();
    beast::get_lowest_layer(client->socket).close();
  }
}

FoxgloveServer::FoxgloveServer(asio::any_io_executor executor, const WebAccess& access,
                               const fit::Mount& lidar)
    : impl_(std::make_shared<Impl>(executor, access, lidar)) {
  impl_->port = listen_on(impl_->acceptor, access, "--foxglove");
  auto accepting = impl_->accept_clients();
  asio::co_spawn(executor, std::move(accepting), asio::detached);
}

FoxgloveServer::~FoxgloveServer() { stop(); }

std::uint16_t FoxgloveServer::port() const { return impl_->port; }
std::string FoxgloveServer::url() const { return url_of("ws", impl_->access, impl_->port); }

void FoxgloveServer::publish(const json& state, std::int64_t time_ns) {
  if (!impl_->stopped) impl_->publish(state, time_ns);
}

void FoxgloveServer::finish(std::function<void()> done) {
  auto sending = impl_->send_last();
  asio::co_spawn(impl_->executor, std::move(sending),
                 [done = std::move(done)](const std::exception_ptr&) { done(); });
}

void FoxgloveServer::stop() { impl_->stop(); }

}  // namespace rig
