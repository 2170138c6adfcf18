// SPDX-License-Identifier: MIT
// Connecting: from an address to a lidar that is identified and silent.
#include <cstdio>

#include "lidar/client_impl.hpp"
#include "lidar/other_connection.hpp"
#include "lidar/status.hpp"

namespace lidar {

/// The lidar's addresses. A name server that does not answer cannot be called off, so its answer, if it
/// comes late, finds nobody waiting.
awaitable<tcp::resolver::results_type> Client::Impl::resolve(steady_clock::time_point until) {
  error_code failed;
  const asio::ip::address numbers = asio::ip::make_address(host, failed);
  if (!failed)
    co_return tcp::resolver::results_type::create(tcp::endpoint(numbers, port), host, std::to_string(port));
  struct Search {
    explicit Search(const asio::any_io_executor& executor_) : resolver(executor_), done(executor_) {}
    tcp::resolver resolver;
    asio::steady_timer done;
    std::optional<error_code> result;
    tcp::resolver::results_type found;
  };
  const auto search = std::make_shared<Search>(executor);
  search->done.expires_at(until);
  search->resolver.async_resolve(host, std::to_string(port),
                                 [search](const error_code& result, tcp::resolver::results_type found) {
                                   search->result = result;
                                   search->found = std::move(found);
                                   search->done.cancel();
                                 });
  co_await search->done.async_wait(redirect_error(use_awaitable, failed));
  if (failed && !search->result) throw boost::system::system_error(failed);
  if (search->result && !*search->result) co_return search->found;
  fail(Kind::unknown_address, "the lidar's host name " + host + " cannot be resolved (" +
                                  (search->result ? search->result->message() : "no name server answered") +
                                  "). Check its spelling, or give the numeric IP address");
}

/// Tries one address after the other, each for its share of the time that is left. Returns why the last one
/// failed.
awaitable<error_code> Client::Impl::connect_to_any(tcp::resolver::results_type found) {
  const auto until = steady_clock::now() + options.connect_timeout;
  error_code failed = asio::error::not_found, ignored;
  auto left = static_cast<int>(found.size());
  for (const auto& entry : found) {
    socket.close(ignored);
    const auto now = steady_clock::now();
    watchdog->guard(socket, now + (until - now) / left--);
    co_await socket.async_connect(entry.endpoint(), redirect_error(use_awaitable, failed));
    watchdog->relax();
    if (!failed) break;
    if (failed == asio::error::operation_aborted && !watchdog->expired)
      throw boost::system::system_error(failed);
  }
  co_return failed;
}

awaitable<void> Client::Impl::open() {
  close();
  const tcp::resolver::results_type found = co_await resolve(steady_clock::now() + options.connect_timeout);
  socket = tcp::socket(executor);
  const error_code failed = co_await connect_to_any(found);
  if (failed == asio::error::connection_refused)
    fail(Kind::cannot_connect,
         "nothing listens at " + address() + " (" + failed.message() + "), though " + host +
             " can be reached. Check that this is the lidar's address and port (a UST-10LX "
             "uses 10940); a lidar that was just switched on needs some seconds");
  if (failed)
    fail(Kind::cannot_connect, "no lidar answers at " + address() + " (" +
                                   (watchdog->expired ? "no reply" : failed.message()) +
                                   "). Check its power, the network cable, that this computer's address is "
                                   "in the same network, and that no other program is connected to it");
  error_code ignored;
  socket.set_option(tcp::no_delay(true), ignored);
  socket.set_option(asio::socket_base::receive_buffer_size(1 << 20), ignored);
  peer = socket.remote_endpoint(ignored);
  own_port = socket.local_endpoint(ignored).port();
  connected = true;
}

/// Longer than the pause between two scans of the present stream.
steady_clock::duration Client::Impl::silence() const {
  constexpr double periods = 2.2;
  const std::chrono::duration<double> between(periods * identity.scan_period_s * (request.skip + 1));
  return std::max<steady_clock::duration>(options.quiet,
                                          std::chrono::duration_cast<steady_clock::duration>(between));
}

/// Reads and forgets whatever comes until nothing has come for a while: the rest of a stream. False when it
/// goes on to `until`.
awaitable<bool> Client::Impl::falls_silent(steady_clock::time_point until) {
  while (steady_clock::now() < until) {
    const bool arrived =
        co_await fill(std::min(steady_clock::now() + silence(), until), "waiting for the stream's end");
    reader.clear();
    if (!arrived) co_return true;
  }
  co_return false;
}

/// QT until it is acknowledged and the stream is silent: real firmware now and then ignores one
/// (urg_stamped #103, #112).
awaitable<void> Client::Impl::end_stream() {
  const auto until = steady_clock::now() + options.stop_timeout;
  const unsigned damaged_before = damaged_answers;
  const bool measured = streaming;
  bool acknowledged = false;
  std::string refusal;
  const Request quit(Command::quit);
  while (steady_clock::now() < until) {
    const std::optional<Answer> answer = co_await exchange(quit);
    if (!answer && damaged_answers - damaged_before >= attempts)
      fail(Kind::bad_answer, "the lidar at " + address() + " answers QT with wrong checksums, " +
                                 std::to_string(damaged_answers - damaged_before) +
                                 " times. Check the network cable; reconnecting may help");
    if (!answer) continue;
    const StatusKind kind = kind_of(answer->status, quit);
    const bool refused = kind != StatusKind::done && kind != StatusKind::already;
    if (refused)
      refusal = "status " + answer->status + ": " + std::string(meaning_of(answer->status, quit));
    else
      acknowledged = true;
    const auto longest = std::max<steady_clock::duration>(options.reply_timeout, 2 * silence());
    auto waiting = falls_silent(std::min(until, steady_clock::now() + longest));
    if (!co_await std::move(waiting)) continue;
    // Refused and silent is as good before anything was measured: in time-adjust mode the laser is off.
    if (refused && measured) continue;
    streaming = false;
    co_return;
  }
  if (!acknowledged && !refusal.empty())
    fail(Kind::refused, "the lidar at " + address() + " refuses to stop measuring (" + refusal +
                            "). Its laser may be on. Switch it off and on");
  fail(Kind::no_answer,
       "the lidar at " + address() +
           (acknowledged ? " keeps sending although it was ordered to stop. Switch it off and on"
                         : " did not acknowledge QT. Check that it speaks SCIP 2 and switch it off and on"));
}

/// TM2 is refused outside time-adjust mode, which is as good.
awaitable<void> Client::Impl::leave_time_adjust() { co_await exchange(Request(Command::time_leave)); }

awaitable<Identity> Client::Impl::identify() {
  const std::string version = co_await ask(Request(Command::version));
  const std::string parameters = co_await ask(Request(Command::parameters));
  const std::string information = co_await ask(Request(Command::information));
  const auto read = make_identity(version, parameters, information);
  if (!read)
    fail(Kind::bad_answer,
         "the lidar at " + address() + " sends an identification that cannot be read: " + read.error());
  co_return *read;
}

/// Ends what an earlier host left running. A lidar that heeds no QT may heed RS, which stops it as well.
awaitable<void> Client::Impl::wake() {
  std::exception_ptr why;
  try {
    co_await end_stream();
    co_return;
  } catch (const LidarError& error) {
    if ((error.kind() != Kind::no_answer && error.kind() != Kind::refused) || !connected) throw;
    why = std::current_exception();
  }
  const std::optional<Answer> answer = co_await exchange(Request(Command::reset));
  if (!answer) std::rethrow_exception(why);
  co_await end_stream();
}

awaitable<Identity> Client::Impl::connect_once() {
  co_await open();
  scan_seen = false;
  damaged_answers = 0;
  // A bare line end first: it ends whatever an earlier host left half written and is never answered.
  co_await send("\n", "connecting");
  std::optional<LidarError> silence;
  try {
    co_await wake();
  } catch (const LidarError& error) {
    silence = error;
  }
  if (silence && (silence->kind() == Kind::no_answer || silence->kind() == Kind::connection_lost)) {
    const bool closed = silence->kind() == Kind::connection_lost;
    const std::string held = other_connection();
    close();
    if (!held.empty())
      throw LidarError(Kind::in_use, "the lidar at " + address() +
                                         (closed ? " closes the connection" : " does not answer") +
                                         " because another program on this computer is connected to it (" +
                                         held +
                                         "), and it serves only one at a time. Close that program first");
    throw LidarError(Kind::not_a_lidar,
                     "something listens at " + address() + (closed ? " but closes the connection" : "") +
                         " and does not answer in SCIP. Check the address and port (a UST-10LX uses 10940), "
                         "and that no other program is connected to it");
  }
  if (silence) throw *silence;
  co_await leave_time_adjust();
  co_return co_await identify();
}

/// Who else of this computer is connected to the address, in words; empty if nobody or if that cannot be
/// told.
std::string Client::Impl::other_connection() const {
  if (!peer.address().is_v4()) return "";
  return other_connection_to(peer.address().to_v4().to_uint(), peer.port(), own_port);
}

/// What a UST damages on its first connection after power-up, it sends whole on the next (urg_node #57). A
/// failure says how often the address was tried in vain, this attempt included.
awaitable<Identity> Client::Impl::connect() {
  if (attempts_failed == 0) first_attempt = steady_clock::now();
  std::optional<LidarError> why;
  for (int connection = 0; connection < 2; ++connection) {
    why.reset();
    try {
      Identity found = co_await connect_once();
      attempts_failed = 0;
      co_return found;
    } catch (const LidarError& error) {
      why = error;
    }
    close();
    ++attempts_failed;
    ++statistics.failed_connects;
    if (why->kind() != Kind::bad_answer) break;
  }
  if (attempts_failed == 1) throw *why;
  const auto since = std::chrono::duration<double>(steady_clock::now() - first_attempt).count();
  char tried[80];
  std::snprintf(tried, sizeof tried, ". Tried %u times in %.1f s", attempts_failed, since);
  throw LidarError(why->kind(), why->what() + std::string(tried));
}

/// What was known of a clock holds for as long as it is the same lidar: reconnect() keeps it.
awaitable<Identity> Client::Impl::connect_first() {
  if (!identity.json.empty()) statistics = {};  // Else attempts in vain are counted on.
  Identity found = co_await connect();
  identity = found;
  const double period_ms = found.scan_period_s * 1000;
  clock = ClockEstimator(period_ms, period_ms * found.max_step / found.steps_per_turn,
                         found.model.starts_with("UST") ? ClockEstimator::Departure::on_tick
                                                        : ClockEstimator::Departure::unknown);
  co_return found;
}

awaitable<Identity> Client::Impl::reconnect() {
  Identity again = co_await connect();
  clock.begin_connection();
  if (!identity.serial.empty() && again.serial != identity.serial) {
    close();
    fail(Kind::refused, "another lidar answers at " + address() + ": serial number " + again.serial +
                            " in place of " + identity.serial +
                            ". Reconnect the first one, or begin a new session");
  }
  ++statistics.reconnects;
  identity = again;
  co_return again;
}

}  // namespace lidar
