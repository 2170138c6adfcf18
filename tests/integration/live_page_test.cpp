// SPDX-License-Identifier: MIT
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <catch2/catch.hpp>
#include <future>
#include <nlohmann/json.hpp>
#include <thread>

#include "rig/errors.hpp"
#include "rig/live/live_server.hpp"

namespace live_page_test {

namespace asio = boost::asio;
namespace http = boost::beast::http;
namespace websocket = boost::beast::websocket;
using asio::ip::tcp;
using rig::LiveServer;

namespace {

/// A server on a thread of its own, as a browser sees it.
struct Served {
  explicit Served(const LiveServer::Options& options = {})
      : live(io.get_executor(), options,
             [this](const nlohmann::json& command) { commands.set_value(command); }),
        thread([this] { io.run(); }) {}
  ~Served() {
    asio::post(io, [this] { live.stop(); });
    thread.join();
  }
  void publish(const nlohmann::json& state) {
    asio::post(io, [this, state] { live.publish(state); });
  }
  http::response<http::string_body> get(const std::string& target, const std::string& host) {
    asio::io_context client;
    boost::beast::tcp_stream stream(client);
    stream.connect(tcp::endpoint(asio::ip::address_v4::loopback(), live.port()));
    http::request<http::empty_body> request(http::verb::get, target, 11);
    request.set(http::field::host, host);
    http::write(stream, request);
    boost::beast::flat_buffer buffer;
    http::response<http::string_body> response;
    http::read(stream, buffer, response);
    return response;
  }
  std::promise<nlohmann::json> commands;
  asio::io_context io;
  LiveServer live;
  std::thread thread;
};

}  // namespace

TEST_CASE("the live page comes whole, from the program alone") {
  Served served;
  const auto page = served.get("/", "127.0.0.1:" + std::to_string(served.live.port()));
  CHECK(page.result() == http::status::ok);
  CHECK(page.body().find("</html>") != std::string::npos);
  CHECK(page.body().find("src=\"http") == std::string::npos);
  CHECK(served.get("/nothing", "localhost").result() == http::status::not_found);
}

TEST_CASE("a page of another site can neither read the state nor press the buttons") {
  Served served;
  CHECK(served.get("/state", "evil.example").result() == http::status::forbidden);
  asio::io_context client;
  websocket::stream<tcp::socket> socket(client);
  socket.next_layer().connect(tcp::endpoint(asio::ip::address_v4::loopback(), served.live.port()));
  socket.set_option(websocket::stream_base::decorator(
      [](websocket::request_type& request) { request.set(http::field::origin, "http://evil.example"); }));
  boost::system::error_code failed;
  socket.handshake("127.0.0.1:" + std::to_string(served.live.port()), "/ws", failed);
  CHECK(failed);
}

TEST_CASE("a browser gets the last state before the page goes away") {
  Served served;
  asio::io_context client;
  websocket::stream<tcp::socket> socket(client);
  socket.next_layer().connect(tcp::endpoint(asio::ip::address_v4::loopback(), served.live.port()));
  socket.handshake("127.0.0.1:" + std::to_string(served.live.port()), "/ws");
  boost::beast::flat_buffer buffer;
  socket.read(buffer);  // The state at the beginning: the server knows this browser.
  std::promise<void> finished;
  asio::post(served.io, [&] {
    served.live.publish({{"phase", "running"}});
    served.live.publish({{"phase", "done"}});
    served.live.finish([&] { finished.set_value(); });
  });
  finished.get_future().wait();
  std::string last;
  boost::system::error_code ended;
  while (!ended) {
    buffer.clear();
    socket.read(buffer, ended);
    if (!ended) last = boost::beast::buffers_to_string(buffer.data());
  }
  CHECK(nlohmann::json::parse(last).at("phase") == "done");
}

TEST_CASE("beyond the loopback interface a token is demanded, and checked") {
  asio::io_context io;
  LiveServer::Options open;
  open.address = "0.0.0.0";
  CHECK_THROWS_AS(LiveServer(io.get_executor(), open, [](const nlohmann::json&) {}), rig::UsageError);
  open.token = "correct-horse";
  Served served(open);
  CHECK(served.get("/?token=wrong", "bench.example").result() == http::status::forbidden);
  CHECK(served.get("/?token=correct-horse", "bench.example").result() == http::status::ok);
}

TEST_CASE("a browser sees the state change and its button reaches the run") {
  Served served;
  served.publish({{"phase", "prompt"}});
  asio::io_context client;
  websocket::stream<tcp::socket> socket(client);
  socket.next_layer().connect(tcp::endpoint(asio::ip::address_v4::loopback(), served.live.port()));
  socket.handshake("127.0.0.1:" + std::to_string(served.live.port()), "/ws");
  boost::beast::flat_buffer buffer;
  socket.read(buffer);
  CHECK(nlohmann::json::parse(boost::beast::buffers_to_string(buffer.data())).at("phase") == "prompt");
  buffer.clear();
  served.publish({{"phase", "running"}});
  socket.read(buffer);
  CHECK(nlohmann::json::parse(boost::beast::buffers_to_string(buffer.data())).at("phase") == "running");
  socket.write(asio::buffer(std::string(R"({"command":"confirm","answer":1.3})")));
  auto arrived = served.commands.get_future();
  REQUIRE(arrived.wait_for(std::chrono::seconds(10)) == std::future_status::ready);
  CHECK(arrived.get().at("answer") == 1.3);
}

}  // namespace live_page_test
