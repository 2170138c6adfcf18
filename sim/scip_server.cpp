// SPDX-License-Identifier: MIT
#include "sim/scip_server.hpp"

#include <algorithm>
#include <array>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/asio/write.hpp>
#include <vector>

#include "sim/bound_port.hpp"

namespace sim {

namespace asio = boost::asio;
using asio::awaitable;
using asio::redirect_error;
using asio::use_awaitable;
using asio::ip::tcp;
using boost::system::error_code;

namespace {
constexpr std::size_t waiting_limit =
    256 * 1024;  // about 38 full scans; beyond, a real device has long dropped some
constexpr std::size_t batch_bytes = 64 * 1024;  // at maximum speed: as much as one write takes well
constexpr auto between_pieces = std::chrono::milliseconds(1);
constexpr int most_pieces = 100;  // of one batch, when it is only to be split
constexpr auto slow_pause = std::chrono::milliseconds(10);
constexpr int scans_at_leisure = 4;  // then a millisecond's rest, when the client lets time pass
constexpr auto idle_check =
    std::chrono::seconds(1);  // no wait without a limit: look again at least this often
}  // namespace

struct ScipServer::Impl : std::enable_shared_from_this<ScipServer::Impl> {
  /// One host. Reader, writer and streamer share it; the first that fails closes the socket and so ends all.
  struct Connection {
    explicit Connection(tcp::socket&& socket_)
        : socket(std::move(socket_)),
          wake_writer(socket.get_executor()),
          wake_streamer(socket.get_executor()) {}
    tcp::socket socket;
    std::string outbox;
    bool closed = false, writing = false, abandoned = false, ends_in_reset = false;
    asio::steady_timer wake_writer, wake_streamer;
    void close() {
      error_code ignored;
      closed = true;
      if (!abandoned) socket.close(ignored);
      wake_writer.cancel();
      wake_streamer.cancel();
    }
    void reset() {
      error_code ignored;
      socket.set_option(asio::socket_base::linger(true, 0), ignored);
      close();
    }
    [[nodiscard]] std::size_t waiting() const { return outbox.size() + (writing ? batch_bytes : 0); }
  };

  Impl(const asio::any_io_executor& executor_, SimClock& clock_, UstDevice& device_)
      : executor(executor_), acceptor(executor_), clock(clock_), device(device_) {}

  asio::any_io_executor executor;
  tcp::acceptor acceptor;
  SimClock& clock;
  UstDevice& device;
  Fault fault;
  std::shared_ptr<Connection> connection;
  bool stopped = false, keeps_streaming = false, listening = false;
  std::uint64_t connections = 0;
  std::vector<std::shared_ptr<Connection>> abandoned;  ///< Still open, as far as their hosts know.
  tcp::endpoint endpoint;
  SimClock::Host::time_point held_until{}, refused_until{}, unserved_until{};
  /// How bytes leave, for a while.
  struct Pieces {
    SimClock::Host::time_point until{};
    std::size_t bytes = 1;
    SimClock::Host::duration pause{};
    int most = 0;  ///< Of one batch; 0: all of it.
  } pieces;

  void send(Connection& to, std::string bytes) {
    bool drop = false;
    if (fault.to_host) bytes = fault.to_host(std::move(bytes), drop);
    to.outbox += bytes;
    to.wake_writer.cancel();
    if (drop) to.close();
  }

  /// Lets go of dead connections that their hosts have given up meanwhile.
  void forget_abandoned() {
    std::erase_if(abandoned, [](const std::shared_ptr<Connection>& host) {
      std::array<char, 512> unread{};
      error_code failed;
      host->socket.non_blocking(true, failed);
      while (!failed) host->socket.read_some(asio::buffer(unread), failed);
      if (failed == asio::error::would_block || failed == asio::error::try_again) return false;
      host->socket.close(failed);
      return true;
    });
  }

  void listen();
  awaitable<void> wait_until(SimClock::Host::time_point when) const;
  awaitable<void> accept_hosts();
  awaitable<void> read_requests(std::shared_ptr<Connection> host);
  awaitable<void> write_answers(std::shared_ptr<Connection> host);
  awaitable<error_code> write_pieces(std::shared_ptr<Connection> host, const std::string& bytes);
  awaitable<void> stream_scans(std::shared_ptr<Connection> host);
  void answer(const std::shared_ptr<Connection>& host, std::string_view line);
};

void ScipServer::Impl::listen() {
  bind_port(acceptor, endpoint, "the lidar's");
  endpoint = acceptor.local_endpoint();
  listening = refused_until <= SimClock::Host::now();
  if (listening) acceptor.listen();  // A port that is only bound refuses.
}

awaitable<void> ScipServer::Impl::wait_until(SimClock::Host::time_point when) const {
  asio::steady_timer timer(executor, when);
  error_code ignored;
  co_await timer.async_wait(redirect_error(use_awaitable, ignored));
}

awaitable<void> ScipServer::Impl::accept_hosts() {
  const auto self = shared_from_this();
  while (!stopped) {
    error_code failed;
    if (!listening) {
      co_await wait_until(refused_until);
      if (stopped) co_return;
      acceptor.listen();
      listening = true;
    }
    tcp::socket socket = co_await acceptor.async_accept(redirect_error(use_awaitable, failed));
    if (stopped) co_return;
    if (failed) {
      auto waiting = wait_until(SimClock::Host::now() + (listening ? idle_check : between_pieces));
      co_await std::move(waiting);
      continue;
    }
    if (unserved_until > SimClock::Host::now()) {
      co_await wait_until(unserved_until);
      if (stopped) co_return;
    }
    socket.set_option(tcp::no_delay(true), failed);
    forget_abandoned();
    const auto host = std::make_shared<Connection>(std::move(socket));
    connection = host;
    ++connections;
    auto writing = write_answers(host);
    asio::co_spawn(executor, std::move(writing), asio::detached);
    auto streaming = stream_scans(host);
    asio::co_spawn(executor, std::move(streaming), asio::detached);
    co_await read_requests(host);
    host->close();
    if (!std::exchange(keeps_streaming, false)) device.disconnected();
    connection.reset();
    if (device.take_reboot_request()) device.reboot(clock.now_s());
  }
}

void ScipServer::Impl::answer(const std::shared_ptr<Connection>& host, std::string_view line) {
  const double now_s = clock.now_s(), at_s = device.answers_at_s(line, now_s);
  clock.advance_to(at_s);
  std::string reply = device.handle(line, at_s);
  clock.advance_to(device.scan_end_s());
  if (at_s > now_s) held_until = std::max(held_until, clock.when(at_s));
  if (!reply.empty()) send(*host, std::move(reply));
  if (device.streaming()) host->wake_streamer.cancel();
}

awaitable<void> ScipServer::Impl::read_requests(std::shared_ptr<Connection> host) {
  const auto self = shared_from_this();
  lidar::RequestReader requests;
  std::array<char, 4096> bytes{};
  while (!host->closed) {
    error_code failed;
    const std::size_t n =
        co_await host->socket.async_read_some(asio::buffer(bytes), redirect_error(use_awaitable, failed));
    if (failed) co_return;
    std::string arrived(bytes.data(), n);
    if (fault.to_device) arrived = fault.to_device(std::move(arrived));
    requests.feed(arrived);
    // What is longer than any request is noise and gets no answer.
    for (auto line = requests.next(); !line || line->has_value(); line = requests.next())
      if (line) answer(host, **line);
    if (device.take_reboot_request()) {
      device.reboot(clock.now_s());
      asio::steady_timer before_drop(executor, std::chrono::milliseconds(20));  // the answer goes out first
      co_await before_drop.async_wait(redirect_error(use_awaitable, failed));
      co_return;
    }
  }
}

awaitable<void> ScipServer::Impl::write_answers(std::shared_ptr<Connection> host) {
  const auto self = shared_from_this();
  error_code failed;
  while (!host->closed) {
    if (host->outbox.empty()) {
      host->wake_writer.expires_after(idle_check);
      co_await host->wake_writer.async_wait(redirect_error(use_awaitable, failed));
      continue;
    }
    if (held_until > SimClock::Host::now()) {
      host->wake_writer.expires_at(held_until);
      co_await host->wake_writer.async_wait(redirect_error(use_awaitable, failed));
      continue;
    }
    const std::string bytes = std::exchange(host->outbox, std::string());
    host->writing = true;
    failed = co_await write_pieces(host, bytes);
    host->writing = false;
    if (!failed && host->ends_in_reset && host->outbox.empty()) host->reset();
    if (failed) {
      host->close();
      co_return;
    }
    host->wake_streamer.cancel();
  }
}

awaitable<error_code> ScipServer::Impl::write_pieces(std::shared_ptr<Connection> host,
                                                     const std::string& bytes) {
  error_code failed;
  std::size_t sent = 0;
  asio::steady_timer pause(executor);
  for (int i = 0; (pieces.most == 0 || i < pieces.most) && pieces.until > SimClock::Host::now() &&
                  sent < bytes.size() && !failed && !host->closed;
       ++i) {
    const std::size_t size = std::min(pieces.bytes, bytes.size() - sent);
    co_await asio::async_write(host->socket, asio::buffer(bytes.data() + sent, size),
                               redirect_error(use_awaitable, failed));
    sent += size;
    error_code ignored;
    pause.expires_after(pieces.pause);
    co_await pause.async_wait(redirect_error(use_awaitable, ignored));
  }
  if (failed || host->closed) co_return failed;
  co_await asio::async_write(host->socket, asio::buffer(bytes.data() + sent, bytes.size() - sent),
                             redirect_error(use_awaitable, failed));
  co_return failed;
}

awaitable<void> ScipServer::Impl::stream_scans(std::shared_ptr<Connection> host) {
  const auto self = shared_from_this();
  error_code ignored;
  std::string bytes;
  while (!host->closed) {
    if (!device.streaming() || (clock.is_max() && host->waiting() > 0)) {
      host->wake_streamer.expires_after(idle_check);
      co_await host->wake_streamer.async_wait(redirect_error(use_awaitable, ignored));
      continue;
    }
    const double ready_s = device.next_scan_ready_s(clock.now_s());
    if (!clock.is_max() && ready_s > clock.now_s()) {
      host->wake_streamer.expires_at(std::min(clock.when(ready_s), SimClock::Host::now() + idle_check));
      co_await host->wake_streamer.async_wait(redirect_error(use_awaitable, ignored));
      continue;
    }
    bytes.clear();
    // Who leaves scans out lets time pass and will stop at a certain one: hours of such a stream would fit
    // into the buffers on the way.
    const bool lets_time_pass = clock.is_max() && device.skips_scans();
    int scans = 0;
    do {
      device.append_next_scan(bytes);
      clock.advance_to(device.scan_end_s());
      ++scans;
    } while (clock.is_max() && device.streaming() && bytes.size() < batch_bytes &&
             !(lets_time_pass && scans == scans_at_leisure) && !(fault.is_due && fault.is_due()));
    if (host->waiting() < waiting_limit) send(*host, bytes);
    // Or a fault swallowed them all: let others run.
    if (lets_time_pass || (clock.is_max() && host->waiting() == 0)) {
      host->wake_streamer.expires_after(std::chrono::milliseconds(1));
      co_await host->wake_streamer.async_wait(redirect_error(use_awaitable, ignored));
    }
  }
}

ScipServer::ScipServer(boost::asio::any_io_executor executor, const Options& options, SimClock& clock,
                       UstDevice& device)
    : impl_(std::make_shared<Impl>(executor, clock, device)) {
  impl_->endpoint = tcp::endpoint(asio::ip::make_address(options.address), options.port);
  impl_->listen();
  auto accepting = impl_->accept_hosts();
  asio::co_spawn(executor, std::move(accepting), asio::detached);
}

ScipServer::~ScipServer() { stop(); }

std::uint16_t ScipServer::port() const { return impl_->endpoint.port(); }

bool ScipServer::has_host() const { return impl_->connection != nullptr; }

std::uint64_t ScipServer::connections() const { return impl_->connections; }

void ScipServer::set_fault(Fault fault) { impl_->fault = std::move(fault); }

void ScipServer::drop_connection() {
  if (impl_->connection) impl_->connection->close();
}

void ScipServer::reset_connection() {
  if (impl_->connection) impl_->connection->reset();
}

void ScipServer::reset_after_output() {
  if (!impl_->connection) return;
  impl_->connection->ends_in_reset = true;
  impl_->connection->wake_writer.cancel();
}

void ScipServer::abandon_connection() {
  if (!impl_->connection) return;
  const auto host = impl_->connection;
  host->abandoned = true;
  host->close();
  error_code ignored;
  host->socket.cancel(ignored);
  impl_->abandoned.push_back(host);
}

namespace {
SimClock::Host::time_point in_real(double seconds) {
  return SimClock::Host::now() +
         std::chrono::duration_cast<SimClock::Host::duration>(std::chrono::duration<double>(seconds));
}
}  // namespace

void ScipServer::hold_output(double seconds) { impl_->held_until = in_real(seconds); }

void ScipServer::split_output(std::size_t piece, double seconds) {
  impl_->pieces = {in_real(seconds), std::max<std::size_t>(piece, 1), between_pieces, most_pieces};
}

void ScipServer::slow_output(double bytes_per_s, double seconds) {
  const double in_a_pause = bytes_per_s * std::chrono::duration<double>(slow_pause).count();
  impl_->pieces = {in_real(seconds), static_cast<std::size_t>(std::clamp(in_a_pause, 1.0, 1e6)), slow_pause,
                   0};
}

void ScipServer::refuse_connections(double seconds) {
  impl_->refused_until = in_real(seconds);
  error_code ignored;
  impl_->acceptor.close(ignored);
  impl_->listen();
}

void ScipServer::serve_nobody(double seconds) { impl_->unserved_until = in_real(seconds); }

void ScipServer::keep_streaming_once() { impl_->keeps_streaming = true; }

void ScipServer::stop() {
  if (impl_->stopped) return;
  impl_->stopped = true;
  error_code ignored;
  impl_->acceptor.close(ignored);
  drop_connection();
  impl_->abandoned.clear();
}

}  // namespace sim
