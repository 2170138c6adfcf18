// SPDX-License-Identifier: MIT
#include "rig/live/foxglove_server.hpp"

#include <algorithm>
#include <array>
#include <boost/beast/http.hpp>
#include <deque>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "rig/json_fields.hpp"
#include "rig/live/foxglove_messages.hpp"
#include "rig/live/web_service.hpp"

namespace rig {
namespace {

namespace beast = boost::beast;
namespace http = beast::http;
using nlohmann::json;

constexpr std::array<const char*, 2> foxglove_protocols{"foxglove.websocket.v1", "foxglove.sdk.v1"};
constexpr WebService::Limits of_foxglove{16, 1 << 16};
constexpr std::size_t most_subscriptions = 100, longest_log = 100;

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

/// A program that subscribed.
struct Client final : WebPeer {
  using WebPeer::WebPeer;
  struct Subscription {
    std::size_t channel;
    std::uint64_t sent = 0;  ///< Number of the last message.
  };
  std::map<std::uint32_t, Subscription> subscriptions;
  std::deque<std::string> texts;  ///< To be sent before anything else.
  bool idle = false;
};

}  // namespace

struct FoxgloveServer::Impl final : WebService {
  Impl(const boost::asio::any_io_executor& executor, const WebAccess& access, const fit::Mount& lidar_)
      : WebService(executor, access, of_foxglove), lidar(lidar_), channels(foxglove_channels().size()) {}

  fit::Mount lidar;
  std::vector<std::deque<StoredMessage>> channels;
  std::uint64_t numbers = 0, logged = 0;

  bool is_welcome(std::string_view origin, std::string_view) const override {
    return is_welcome_origin(origin);
  }
  WebResponse respond(const WebRequest& request) const override;
  std::optional<std::string> protocol_of(const WebRequest& request) const override {
    const std::string protocol = offered_protocol(request);
    return protocol.empty() ? std::nullopt : std::optional(protocol);
  }
  Peer new_peer(beast::tcp_stream&& stream) const override;
  boost::asio::awaitable<void> send(Peer peer) override;
  void receive(WebPeer& peer, const std::string& message, bool is_text) override;
  bool has_all(const WebPeer& peer) const override { return static_cast<const Client&>(peer).idle; }

  void publish(const json& state, std::int64_t time_ns);
  void obey(Client& client, const std::string& text) const;
  [[nodiscard]] std::optional<std::string> next_frame(Client& client) const;
  [[nodiscard]] static std::deque<std::string> greeting();
};

WebResponse FoxgloveServer::Impl::respond(const WebRequest& request) const {
  const bool allowed = admits(request);
  WebResponse response{allowed ? http::status::bad_request : http::status::forbidden, request.version()};
  response.set(http::field::content_type, "text/plain; charset=utf-8");
  response.body() = allowed ? "These are a run's data for Foxglove: open " + url("ws") +
                                  " there, as a Foxglove WebSocket connection.\n"
                            : "Refused: use the exact address that rig printed, with its token.\n";
  response.keep_alive(false);
  response.prepare_payload();
  return response;
}

WebService::Peer FoxgloveServer::Impl::new_peer(beast::tcp_stream&& stream) const {
  auto client = std::make_shared<Client>(std::move(stream));
  client->texts = greeting();
  return client;
}

std::deque<std::string> FoxgloveServer::Impl::greeting() {
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

boost::asio::awaitable<void> FoxgloveServer::Impl::send(Peer peer) {
  const auto self = shared_from_this();
  auto& client = static_cast<Client&>(*peer);
  while (!stopped() && client.socket.is_open()) {
    bool sent = false;
    while (!client.texts.empty()) {
      const std::string text = client.texts.front();
      client.texts.pop_front();
      if (!co_await write(client, text, true)) co_return;
    }
    while (client.texts.empty()) {
      const auto frame = next_frame(client);
      if (!frame) break;
      if (!co_await write(client, *frame, false)) co_return;
      sent = true;
    }
    if (!client.texts.empty()) continue;
    client.idle = !sent;
    const auto longest = sent ? web_message_spacing : std::chrono::milliseconds(5000);
    co_await wait_for_news(client, longest);
    client.idle = false;
  }
}

void FoxgloveServer::Impl::receive(WebPeer& peer, const std::string& message, bool is_text) {
  if (is_text) obey(static_cast<Client&>(peer), message);
  peer.wake.cancel();
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
                                {"message", "a run is read-only: '" + op.substr(0, 60) + "' is not served"}}
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
  for (const Peer& peer : peers()) {
    auto& client = static_cast<Client&>(*peer);
    if (client.idle) client.wake.cancel();
    client.idle = false;  // It has something to get, which finish() waits for.
  }
}

FoxgloveServer::FoxgloveServer(boost::asio::any_io_executor executor, const WebAccess& access,
                               const fit::Mount& lidar)
    : impl_(std::make_shared<Impl>(executor, access, lidar)) {
  impl_->listen("--foxglove");
}

FoxgloveServer::~FoxgloveServer() { stop(); }

std::uint16_t FoxgloveServer::port() const { return impl_->port(); }
std::string FoxgloveServer::url() const { return impl_->url("ws"); }

void FoxgloveServer::publish(const json& state, std::int64_t time_ns) {
  if (!impl_->stopped()) impl_->publish(state, time_ns);
}

void FoxgloveServer::finish(std::function<void()> done) { impl_->finish(std::move(done)); }

void FoxgloveServer::stop() { impl_->stop(); }

}  // namespace rig
