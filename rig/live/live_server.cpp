// SPDX-License-Identifier: MIT
#include "rig/live/live_server.hpp"

#include <boost/beast/http.hpp>
#include <nlohmann/json.hpp>

#include "rig/live/web_service.hpp"

namespace rig {

namespace {

namespace beast = boost::beast;
namespace http = beast::http;

constexpr WebService::Limits of_the_page{32, 4096};

WebResponse answer(const WebRequest& request, http::status status, const char* type, std::string body) {
  WebResponse response{status, request.version()};
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

/// A browser that shows the page.
struct Browser final : WebPeer {
  using WebPeer::WebPeer;
  std::uint64_t seen = 0, sent = 0;  ///< Versions of the state.
};

}  // namespace

struct LiveServer::Impl final : WebService {
  Impl(const boost::asio::any_io_executor& executor, const Options& options, OnCommand on_command_,
       const char* page_)
      : WebService(executor, options, of_the_page), on_command(std::move(on_command_)), page(page_) {}

  OnCommand on_command;
  const char* page;
  std::shared_ptr<const std::string> state = std::make_shared<const std::string>("{}");
  std::uint64_t version = 1;
  std::string picture_type, picture;

  /// Only our own page may press our buttons.
  bool is_welcome(std::string_view origin, std::string_view host) const override {
    return origin == "http://" + std::string(host);
  }
  WebResponse respond(const WebRequest& request) const override;
  Peer new_peer(beast::tcp_stream&& stream) const override {
    return std::make_shared<Browser>(std::move(stream));
  }
  boost::asio::awaitable<void> send(Peer peer) override;
  void receive(WebPeer& peer, const std::string& message, bool is_text) override;
  bool has_all(const WebPeer& peer) const override {
    return static_cast<const Browser&>(peer).sent == version;
  }
};

WebResponse LiveServer::Impl::respond(const WebRequest& request) const {
  const std::string target(request.target().substr(0, request.target().find('?')));
  if (!admits(request))
    return answer(request, http::status::forbidden, "text/plain; charset=utf-8",
                  "Refused: open the exact address that rig printed, with its token.\n");
  if (request.method() != http::verb::get && request.method() != http::verb::head)
    return answer(request, http::status::method_not_allowed, "text/plain; charset=utf-8",
                  "Only GET is served.\n");
  if (target == "/") return answer(request, http::status::ok, "text/html; charset=utf-8", page);
  if (target == "/picture" && !picture.empty())
    return answer(request, http::status::ok, picture_type.c_str(), picture);
  if (target == "/state") return answer(request, http::status::ok, "application/json", *state);
  return answer(request, http::status::not_found, "text/plain; charset=utf-8",
                "Nothing here: the page is at /\n");
}

boost::asio::awaitable<void> LiveServer::Impl::send(Peer peer) {
  const auto self = shared_from_this();
  auto& browser = static_cast<Browser&>(*peer);
  while (!stopped() && browser.socket.is_open()) {
    if (browser.seen == version) {
      co_await wait_for_news(browser, std::chrono::seconds(5));
      continue;
    }
    const std::uint64_t sending = browser.seen = version;
    const auto text = state;
    if (!co_await write(browser, *text, true)) co_return;
    browser.sent = sending;
    co_await pause(web_message_spacing);
  }
}

void LiveServer::Impl::receive(WebPeer&, const std::string& message, bool) {
  const auto command = nlohmann::json::parse(message, nullptr, false);
  if (command.is_object() && command.contains("command") && command.at("command").is_string())
    on_command(command);
}

LiveServer::LiveServer(boost::asio::any_io_executor executor, const Options& options, OnCommand on_command,
                       const char* page)
    : impl_(std::make_shared<Impl>(executor, options, std::move(on_command), page)) {
  impl_->listen("--live");
}

LiveServer::~LiveServer() { stop(); }

std::uint16_t LiveServer::port() const { return impl_->port(); }

std::string LiveServer::url() const { return impl_->url("http"); }

void LiveServer::publish(const nlohmann::json& state) {
  if (impl_->stopped()) return;
  impl_->state = std::make_shared<const std::string>(
      state.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
  ++impl_->version;
  for (const auto& browser : impl_->peers()) browser->wake.cancel();
}

void LiveServer::show_picture(const std::string& type, std::string bytes) {
  impl_->picture_type = type;
  impl_->picture = std::move(bytes);
}

void LiveServer::finish(std::function<void()> done) { impl_->finish(std::move(done)); }

void LiveServer::stop() { impl_->stop(); }

}  // namespace rig
