// SPDX-License-Identifier: MIT
#include "rig/live/live_server.hpp"

#include <algorithm>
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
#include <list>
#include <nlohmann/json.hpp>

namespace rig {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using asio::awaitable;
using asio::use_awaitable;
using Clock = std::chrono::steady_clock;
using namespace std::chrono_literals;

constexpr auto request_limit = 10s;
constexpr auto frame_spacing = 50ms;
constexpr std::size_t most_browsers = 32;
constexpr std::size_t largest_command_bytes = 4096;

using Request = WebRequest;
using Response = http::response<http::string_body>;
using WebSocket = websocket::stream<beast::tcp_stream>;

Response answer(const Request& request, http::status status, const char* type, std::string body) {
  Response response{status, request.version()};
  response.set(http::field::server, "rig");
  response.set(http::field::content_type, type);
  response.set(http::field::cache_control, "no-store");
  response.set("X-Content-Type-Options", "nosniff");
  response.set("X-Frame-Options", "DENY");
  response.set("Referrer-Policy", "no-referrer");
  response.set("Content-Security-Policy",
               "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; connect-src "
               "'self'; img-src 'self' data:");
  response.keep_alive(false);
  response.body() = std::move(body);
  response.prepare_payload();
  return response;
}

}  // namespace

struct LiveServer::Impl : std::enable_shared_from_this<LiveServer::Impl> {
  struct Browser {
    explicit Browser(beast::tcp_stream&& stream, const asio::any_io_executor& executor)
        : socket(std::move(stream)), wake(executor) {}
    WebSocket socket;
    asio::steady_timer wake;
    std::uint64_t seen = 0, sent = 0;
  };

  Impl(const asio::any_io_executor& executor_, const Options& options_, OnCommand on_command_, const char* page_)
      : executor(executor_), options(options_), on_command(std::move(on_command_)), page(page_), acceptor(executor_) {}

  asio::any_io_executor executor;
  Options options;
  OnCommand on_command;
  const char* page;
  asio::ip::tcp::acceptor acceptor;
  std::uint16_t port = 0;
  std::list<std::shared_ptr<Browser>> browsers;
  std::shared_ptr<const std::string> state = std::make_shared<const std::string>("{}");
  std::uint64_t version = 1;
  std::string picture_type, picture;
  bool stopped = false;

  void listen();
  awaitable<void> accept_browsers();
  awaitable<void> serve(asio::ip::tcp::socket socket);
  awaitable<void> serve_websocket(beast::tcp_stream stream, Request request);
  awaitable<void> send_states(std::shared_ptr<Browser> browser);
  awaitable<void> receive_commands(std::shared_ptr<Browser> browser);
  awaitable<void> send_last_state();
  void stop();
  [[nodiscard]] bool admits(const Request& request) const;
  [[nodiscard]] Response respond(const Request& request) const;
};

void LiveServer::Impl::listen() { port = listen_on(acceptor, options, "--live"); }

awaitable<void> LiveServer::Impl::accept_browsers() {
  const auto self = shared_from_this();
  while (!stopped) {
    boost::system::error_code failed;
    auto socket = co_await acceptor.async_accept(asio::redirect_error(use_awaitable, failed));
    if (stopped) break;
    if (failed) {  // out of descriptors, say: try again shortly instead of spinning
      asio::steady_timer pause(executor, 100ms);
      co_await pause.async_wait(asio::redirect_error(use_awaitable, failed));
      continue;
    }
    auto session = serve(std::move(socket));
    asio::co_spawn(executor, std::move(session), [self](const std::exception_ptr&) {});
  }
}

/// Origin, where sent, must be ours: a foreign page in a browser of this computer must not press our buttons.
bool LiveServer::Impl::admits(const Request& request) const {
  const std::string host(request[http::field::host]);
  const auto origin = request.find(http::field::origin);
  if (origin != request.end() && origin->value() != "http://" + host) return false;
  return admits_host_and_token(request, options);
}

Response LiveServer::Impl::respond(const Request& request) const {
  const std::string target(request.target().substr(0, request.target().find('?')));
  if (!admits(request))
    return answer(request, http::status::forbidden, "text/plain; charset=utf-8",
                  "Refused: open the exact address that rig printed, with its token.\n");
  if (request.method() != http::verb::get && request.method() != http::verb::head)
    return answer(request, http::status::method_not_allowed, "text/plain; charset=utf-8", "Only GET.\n");
  if (target == "/") return answer(request, http::status::ok, "text/html; charset=utf-8", page);
  if (target == "/picture" && !picture.empty())
    return answer(request, http::status::ok, picture_type.c_str(), picture);
  if (target == "/state") return answer(request, http::status::ok, "application/json", *state);
  return answer(request, http::status::not_found, "text/plain; charset=utf-8",
                "Nothing here: the page is at /\n");
}

awaitable<void> LiveServer::Impl::serve(asio::ip::tcp::socket socket) {
  const auto self = shared_from_this();
  beast::tcp_stream stream(std::move(socket));
  beast::flat_buffer buffer;
  http::request_parser<http::string_body> parser;
  parser.body_limit(largest_command_bytes);
  parser.header_limit(8192);
  stream.expires_after(request_limit);
  boost::system::error_code failed;
  co_await http::async_read(stream, buffer, parser, asio::redirect_error(use_awaitable, failed));
  if (failed) co_return;
  Request request = parser.release();
  if (websocket::is_upgrade(request) && admits(request) && browsers.size() < most_browsers) {
    auto upgraded = serve_websocket(std::move(stream), std::move(request));
    co_await std::move(upgraded);
    co_return;
  }
  const Response response = respond(request);
  stream.expires_after(request_limit);
  co_await http::async_write(stream, response, asio::redirect_error(use_awaitable, failed));
  stream.socket().shutdown(asio::ip::tcp::socket::shutdown_send, failed);
}

awaitable<void> LiveServer::Impl::serve_websocket(beast::tcp_stream stream, Request request) {
  const auto self = shared_from_this();
  const auto browser = std::make_shared<Browser>(std::move(stream), executor);
  beast::get_lowest_layer(browser->socket).expires_never();
  auto timeout = websocket::stream_base::timeout::suggested(beast::role_type::server);
  timeout.idle_timeout = 20s;  // with pings: a browser that vanished is noticed and dropped
  timeout.keep_alive_pings = true;
  browser->socket.set_option(timeout);
  browser->socket.read_message_max(largest_command_bytes);
  boost::system::error_code failed;
  co_await browser->socket.async_accept(request, asio::redirect_error(use_awaitable, failed));
  if (failed || stopped) co_return;
  browsers.push_back(browser);
  auto sending = send_states(browser);
  asio::co_spawn(executor, std::move(sending), asio::detached);
  auto receiving = receive_commands(browser);
  co_await std::move(receiving);
  browsers.remove(browser);
  browser->wake.cancel();
}

awaitable<void> LiveServer::Impl::send_states(std::shared_ptr<Browser> browser) {
  const auto self = shared_from_this();
  boost::system::error_code failed;
  while (!stopped && browser->socket.is_open()) {
    if (browser->seen == version) {
      browser->wake.expires_after(5s);
      co_await browser->wake.async_wait(asio::redirect_error(use_awaitable, failed));
      continue;
    }
    const std::uint64_t sending = browser->seen = version;
    const auto text = state;
    browser->socket.text(true);
    co_await browser->socket.async_write(asio::buffer(*text), asio::redirect_error(use_awaitable, failed));
    if (failed) co_return;
    browser->sent = sending;
    asio::steady_timer pace(executor, frame_spacing);
    co_await pace.async_wait(asio::redirect_error(use_awaitable, failed));
  }
}

awaitable<void> LiveServer::Impl::receive_commands(std::shared_ptr<Browser> browser) {
  const auto self = shared_from_this();
  boost::system::error_code failed;
  while (!stopped) {
    beast::flat_buffer buffer;
    co_await browser->socket.async_read(buffer, asio::redirect_error(use_awaitable, failed));
    if (failed) co_return;
    const auto command = nlohmann::json::parse(beast::buffers_to_string(buffer.data()), nullptr, false);
    if (command.is_object() && command.contains("command") && command.at("command").is_string())
      on_command(command);
  }
}

awaitable<void> LiveServer::Impl::send_last_state() {
  const auto self = shared_from_this();
  const auto limit = Clock::now() + 1s;
  const auto waits = [this](const std::shared_ptr<Browser>& browser) { return browser->sent != version; };
  while (std::any_of(browsers.begin(), browsers.end(), waits) && Clock::now() < limit) {
    asio::steady_timer pause(executor, 10ms);
    boost::system::error_code failed;
    co_await pause.async_wait(asio::redirect_error(use_awaitable, failed));
  }
  stop();
}

void LiveServer::Impl::stop() {
  if (stopped) return;
  stopped = true;
  boost::system::error_code ignored;
  acceptor.close(ignored);
  for (const auto& browser : browsers) {
    browser->wake.cancel();
    beast::get_lowest_layer(browser->socket).close();
  }
}

LiveServer::LiveServer(boost::asio::any_io_executor executor, const Options& options, OnCommand on_command,
                       const char* page)
    : impl_(std::make_shared<Impl>(executor, options, std::move(on_command), page)) {
  impl_->listen();
  auto accepting = impl_->accept_browsers();
  asio::co_spawn(executor, std::move(accepting), asio::detached);
}

LiveServer::~LiveServer() { stop(); }

std::uint16_t LiveServer::port() const { return impl_->port; }

std::string LiveServer::url() const { return url_of("http", impl_->options, impl_->port); }

void LiveServer::publish(const nlohmann::json& state) {
  if (impl_->stopped) return;
  impl_->state = std::make_shared<const std::string>(
      state.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
  ++impl_->version;
  for (const auto& browser : impl_->browsers) browser->wake.cancel();
}

void LiveServer::show_picture(const std::string& type, std::string bytes) {
  impl_->picture_type = type;
  impl_->picture = std::move(bytes);
}

void LiveServer::finish(std::function<void()> done) {
  auto sending = impl_->send_last_state();
  asio::co_spawn(impl_->executor, std::move(sending),
                 [done = std::move(done)](const std::exception_ptr&) { done(); });
}

void LiveServer::stop() { impl_->stop(); }

}  // namespace rig
