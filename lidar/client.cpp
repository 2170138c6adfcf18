// SPDX-License-Identifier: MIT
#include "lidar/client.hpp"

#include <algorithm>
#include <cmath>

#include "lidar/client_impl.hpp"
#include "lidar/reply.hpp"

namespace lidar {
namespace {

constexpr int exchanges_wanted = 150;  // TM1 rounds of a synchronisation

}  // namespace

/// Rounds of TM1, sent when they tell most.
awaitable<void> Client::Impl::exchange_times() {
  asio::steady_timer pause(executor);
  double late_us = 50;  // how much later than asked a timer of this host wakes us
  clock.begin_exchanges();
  for (int round = 0; round < exchanges_wanted && clock.follows_host(); ++round) {
    const auto now = static_cast<double>(now_us());
    const double send_at = clock.best_time_to_send(now + late_us + 100);
    pause.expires_after(std::chrono::microseconds(std::llround(send_at - late_us - now)));
    error_code failed;
    co_await pause.async_wait(redirect_error(use_awaitable, failed));
    if (failed) throw boost::system::system_error(failed);
    const auto sent = static_cast<double>(now_us());
    late_us += (sent - send_at) / 4;
    late_us = std::clamp(late_us, 0.0, 1000.0);
    const std::optional<Answer> answer = co_await exchange(Request(Command::time_read));
    if (!answer) continue;
    if (const auto stamp = decode_time(answer->body)) {
      const auto received = static_cast<double>(arrived_us);
      const auto device = clock.unwrap(static_cast<std::uint32_t>(*stamp & 0xFFFFFF), received);
      clock.add_exchange(sent, received, device);
    }
  }
  clock.end_exchanges();
}

awaitable<ClockEstimate> Client::Impl::synchronise() {
  if (streaming) co_await stop();
  co_await ask(Request(Command::time_enter));
  std::exception_ptr why;
  try {
    co_await exchange_times();
  } catch (...) {
    why = std::current_exception();
  }
  if (connected) {
    const auto cancelled = co_await asio::this_coro::cancellation_state;
    if (cancelled.cancelled() != asio::cancellation_type::none)
      co_await asio::this_coro::reset_cancellation_state(asio::disable_cancellation());
    co_await leave_time_adjust();
  }
  if (why) std::rethrow_exception(why);
  co_return clock.estimate();
}

// --- the public face --------------------------------------------------------------------------------------

Client::Client(asio::any_io_executor executor, std::string host, std::uint16_t port, Options options)
    : impl_(std::make_unique<Impl>(std::move(executor), std::move(host), port, options)) {}

Client::~Client() {
  if (!impl_->connected) return;
  error_code ignored;
  impl_->socket.non_blocking(true, ignored);
  impl_->socket.write_some(asio::buffer("QT\n", 3), ignored);
}

awaitable<Identity> Client::connect() {
  auto work = impl_->connect_first();
  return ending_in_silence(*impl_, std::move(work));
}
awaitable<Identity> Client::reconnect() {
  auto work = impl_->reconnect();
  return ending_in_silence(*impl_, std::move(work));
}
awaitable<void> Client::start(StreamRequest request) {
  auto work = impl_->start(request);
  return ending_in_silence(*impl_, std::move(work));
}
awaitable<Scan> Client::next() { return impl_->next(); }
void Client::reuse(Scan scan) { impl_->spare = std::move(scan); }
awaitable<void> Client::stop() {
  auto work = impl_->stop();
  return ending_in_silence(*impl_, std::move(work));
}
awaitable<ClockEstimate> Client::synchronise() {
  auto work = impl_->synchronise();
  return ending_in_silence(*impl_, std::move(work));
}
void Client::close() { impl_->close(); }

bool Client::connected() const { return impl_->connected; }
bool Client::streaming() const { return impl_->streaming; }
const Identity& Client::identity() const { return impl_->identity; }
Statistics Client::statistics() const { return impl_->statistics; }
ClockEstimate Client::clock() const { return impl_->clock.estimate(); }

}  // namespace lidar
