// SPDX-License-Identifier: MIT
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>

#include "rig/command.hpp"
#include "rig/live/benches_state.hpp"
#include "rig/live/live_server.hpp"
#include "rig/live/session_state.hpp"

namespace rig::commands {
namespace {

namespace asio = boost::asio;

asio::awaitable<void> follow(const SessionStore& session, LiveServer& live) {
  asio::steady_timer timer(co_await asio::this_coro::executor);
  for (std::string shown;;) {
    const nlohmann::json state = state_of(session);
    std::string text = state.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
    if (text != shown) live.publish(state);
    shown = std::move(text);
    timer.expires_after(std::chrono::milliseconds(500));
    boost::system::error_code cancelled;
    co_await timer.async_wait(asio::redirect_error(asio::use_awaitable, cancelled));
    if (cancelled) co_return;
  }
}

asio::awaitable<void> follow(BenchesState& benches, LiveServer& live) {
  asio::steady_timer timer(co_await asio::this_coro::executor);
  while (true) {
    live.publish(benches.observe(std::time(nullptr)));
    timer.expires_after(std::chrono::seconds(1));
    boost::system::error_code cancelled;
    co_await timer.async_wait(asio::redirect_error(asio::use_awaitable, cancelled));
    if (cancelled) co_return;
  }
}

class Watch : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* command = root.add_subcommand(
        "watch",
        "Shows a session in the browser, while another program records it or afterwards; for a folder, all "
        "benches that write into it and which of them need an operator");
    command->add_option("session", session_, "Session file (*.rig), or a folder of them")->required();
    command->add_option("--live", options_.port, "Port of the page; 0 picks a free one")
        ->capture_default_str();
    command
        ->add_option("--live-listen", options_.address,
                     "Address to listen on; any other than loopback needs --live-token")
        ->capture_default_str();
    command->add_option("--live-token", options_.token, "Secret that the page's address must contain");
    return command;
  }

  int run() override {
    if (std::filesystem::is_directory(session_)) {
      BenchesState benches(session_);
      return serve(benches_page, [&](LiveServer& live) { return follow(benches, live); });
    }
    const SessionStore session(session_, SessionStore::Mode::read);
    return serve(live_page, [&](LiveServer& live) { return follow(session, live); });
  }

 private:
  /// Until Ctrl-C.
  int serve(const char* page, const std::function<asio::awaitable<void>(LiveServer&)>& follow_it) const {
    asio::io_context io(1);
    LiveServer live(
        io.get_executor(), options_, [](const nlohmann::json&) {}, page);
    std::fprintf(stderr, "watching %s at %s   (Ctrl-C ends)\n", session_.c_str(), live.url().c_str());
    asio::signal_set signals(io, SIGINT, SIGTERM);
    signals.async_wait([&io](const boost::system::error_code&, int) { io.stop(); });
    std::exception_ptr failure;
    auto following = follow_it(live);
    asio::co_spawn(io, std::move(following), [&](const std::exception_ptr& why) {
      failure = why;
      io.stop();
    });
    io.run();
    if (failure) std::rethrow_exception(failure);
    return 0;
  }

  std::string session_;
  LiveServer::Options options_;
};

}  // namespace

std::unique_ptr<Command> make_watch() { return std::make_unique<Watch>(); }

}  // namespace rig::commands
