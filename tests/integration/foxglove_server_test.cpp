// SPDX-License-Identifier: MIT
#include "rig/live/foxglove_server.hpp"

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <catch2/catch.hpp>
#include <cstring>
#include <future>
#include <nlohmann/json.hpp>
#include <thread>

#include "rig/errors.hpp"
#include "rig/live/foxglove_messages.hpp"

namespace foxglove_server_test {

namespace asio = boost::asio;
namespace websocket = boost::beast::websocket;
using asio::ip::tcp;
using nlohmann::json;

namespace {

using ClientSocket = websocket::stream<tcp::socket>;

/// A server on a thread of its own.
struct ServedToFoxglove {
  explicit ServedToFoxglove(const rig::WebAccess& access = {})
      : server(io.get_executor(), access, fit::Mount{}), thread([this] { io.run(); }) {}
  ~ServedToFoxglove() {
    asio::post(io, [this] { server.stop(); });
    thread.join();
  }
  void publish(const json& state) {
    std::promise<void> done;
    asio::post(io, [&] {
      server.publish(state, 1'700'000'000'000'000'123);
      done.set_value();
    });
    done.get_future().wait();
  }
  /// What a handshake with this origin and subprotocol ends with.
  boost::system::error_code connect(ClientSocket& socket, const std::string& protocol,
                                    const std::string& origin = "", const std::string& target = "/") {
    socket.next_layer().connect(tcp::endpoint(asio::ip::address_v4::loopback(), server.port()));
    socket.set_option(websocket::stream_base::decorator([=](websocket::request_type& request) {
      if (!protocol.empty()) request.set(boost::beast::http::field::sec_websocket_protocol, protocol);
      if (!origin.empty()) request.set(boost::beast::http::field::origin, origin);
    }));
    boost::system::error_code failed;
    socket.handshake("127.0.0.1:" + std::to_string(server.port()), target, failed);
    return failed;
  }
  asio::io_context io;
  rig::FoxgloveServer server;
  std::thread thread;
};

std::string next(ClientSocket& socket) {
  boost::beast::flat_buffer buffer;
  socket.read(buffer);
  return boost::beast::buffers_to_string(buffer.data());
}

/// Subscription, time and body of the next message.
std::tuple<std::uint32_t, std::uint64_t, json> next_message(ClientSocket& socket) {
  const std::string frame = next(socket);
  REQUIRE(frame.size() > 13);
  REQUIRE(frame[0] == 1);
  std::uint32_t subscription = 0;
  std::uint64_t time_ns = 0;
  std::memcpy(&subscription, frame.data() + 1, 4);
  std::memcpy(&time_ns, frame.data() + 5, 8);
  return {subscription, time_ns, json::parse(frame.substr(13))};
}

void send(ClientSocket& socket, const json& message) {
  socket.text(true);
  socket.write(asio::buffer(message.dump()));
}

const char* const protocol = "foxglove.websocket.v1";

}  // namespace

TEST_CASE("Foxglove gets the channels at once, and of a topic what was published before it asked") {
  ServedToFoxglove served;
  served.publish({{"phase", "running"}, {"stage_deg", 30.0}});
  asio::io_context io;
  ClientSocket socket(io);
  REQUIRE_FALSE(served.connect(socket, protocol));
  CHECK(json::parse(next(socket))["op"] == "serverInfo");
  const json advertised = json::parse(next(socket));
  REQUIRE(advertised["channels"].size() == rig::foxglove_channels().size());
  std::size_t stage = 0;
  for (const json& channel : advertised["channels"])
    if (channel["topic"] == "/stage") stage = channel["id"];
  send(socket, {{"op", "subscribe"}, {"subscriptions", {{{"id", 77}, {"channelId", stage}}}}});
  const auto [subscription, time_ns, body] = next_message(socket);
  CHECK(subscription == 77);
  CHECK(time_ns == 1'700'000'000'000'000'123);
  CHECK(body["angle_deg"] == 30.0);
  CHECK(body["timestamp"]["nsec"] == 123);
  served.publish({{"stage_deg", 31.0}});
  CHECK(std::get<2>(next_message(socket))["angle_deg"] == 31.0);
}

TEST_CASE("a log loses none of its messages, whoever is slow, and none comes twice") {
  ServedToFoxglove served;
  const auto state_of = [](int from, int to) {
    json messages = json::array();
    for (int i = from; i < to; ++i) messages.push_back({{"level", "info"}, {"text", std::to_string(i)}});
    return json{{"messages", messages}, {"messages_total", to}};
  };
  served.publish(state_of(0, 3));
  served.publish(state_of(1, 5));
  asio::io_context io;
  ClientSocket socket(io);
  REQUIRE_FALSE(served.connect(socket, protocol));
  next(socket), next(socket);
  send(socket, {{"op", "subscribe"}, {"subscriptions", {{{"id", 1}, {"channelId", 3}}}}});
  for (int i = 0; i < 5; ++i) CHECK(std::get<2>(next_message(socket))["message"] == std::to_string(i));
  served.publish(state_of(1, 5));
  served.publish(state_of(2, 6));
  CHECK(std::get<2>(next_message(socket))["message"] == "5");
}

TEST_CASE("a client that sends anything else learns that a run is read only, and stays connected") {
  ServedToFoxglove served;
  asio::io_context io;
  ClientSocket socket(io);
  REQUIRE_FALSE(served.connect(socket, "foxglove.sdk.v1"));
  next(socket), next(socket);
  for (const char* text : {"no json", "[]", R"({"op": 7})", R"({"op": "setParameters"})",
                           R"({"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 99}, 5]})"}) {
    socket.text(true);
    socket.write(asio::buffer(std::string(text)));
  }
  for (int i = 0; i < 4; ++i) CHECK(json::parse(next(socket))["op"] == "status");
  send(socket, {{"op", "subscribe"}, {"subscriptions", {{{"id", 2}, {"channelId", 6}}}}});
  served.publish({{"phase", "paused"}});
  CHECK(std::get<2>(next_message(socket))["phase"] == "paused");
}

TEST_CASE("pages of other sites, and those that speak another protocol, are refused; Foxglove's own is not") {
  ServedToFoxglove served;
  asio::io_context io;
  const auto refused = [&](const std::string& spoken, const std::string& origin) {
    ClientSocket socket(io);
    return static_cast<bool>(served.connect(socket, spoken, origin));
  };
  CHECK(refused(protocol, "https://evil.example"));
  CHECK(refused(protocol, "https://app.foxglove.dev.evil.example"));
  CHECK(refused("", ""));
  CHECK(refused("chat", ""));
  CHECK_FALSE(refused(protocol, "https://app.foxglove.dev"));
  CHECK_FALSE(refused(protocol, "http://localhost:8080"));
  rig::WebAccess open;
  open.address = "0.0.0.0";
  CHECK_THROWS_AS(ServedToFoxglove(open), rig::UsageError);
  open.token = "secret";
  ServedToFoxglove guarded(open);
  ClientSocket without(io), with(io);
  CHECK(guarded.connect(without, protocol));
  CHECK_FALSE(guarded.connect(with, protocol, "", "/?token=secret"));
}

TEST_CASE("a state of the live page becomes Foxglove's scan in metres and the stage's transform") {
  fit::Mount lidar;
  lidar.x_mm.value = 100;
  const json state = {
      {"stage_deg", 90.0},
      {"scan",
       {{"first_deg", -45.0}, {"step_deg", 45.0}, {"range_mm", {1000, 0, 2500}}, {"intensity", {1, 2, 3}}}},
      {"beam", {{"step", 540}, {"range_mm", {1400, 1401}}}}};
  json scan, transform, beam;
  for (const auto& message : rig::foxglove_messages(state, 5'000'000'007, lidar, 0)) {
    const std::string topic = rig::foxglove_channels()[message.channel].topic;
    if (topic == "/scan") scan = message.body;
    if (topic == "/tf") transform = message.body;
    if (topic == "/beam") beam = message.body;
  }
  CHECK(scan["ranges"] == json({1.0, 0.0, 2.5}));
  CHECK(scan["end_angle"].get<double>() == Approx(fit::pi / 4));
  CHECK(scan["timestamp"] == json({{"sec", 5}, {"nsec", 7}}));
  CHECK(transform["translation"]["y"].get<double>() == Approx(0.1));
  CHECK(transform["rotation"]["w"].get<double>() == Approx(std::sqrt(0.5)));
  CHECK(beam["range_mm"] == 1401);
}

}  // namespace foxglove_server_test
