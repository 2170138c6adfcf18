// SPDX-License-Identifier: MIT
#include "lidar/client.hpp"

#include <array>
#include <boost/asio/connect.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/this_coro.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/asio/write.hpp>
#include <charconv>
#include <cstdio>

#include "lidar/frame_reader.hpp"
#include "lidar/identity.hpp"
#include "lidar/other_connection.hpp"
#include "lidar/reply.hpp"
#include "lidar/request.hpp"
#include "lidar/scan_receiver.hpp"
#include "lidar/status.hpp"

namespace lidar {

namespace asio = boost::asio;
using asio::awaitable;
using asio::redirect_error;
using asio::use_awaitable;
using asio::ip::tcp;
using boost::system::error_code;
using std::chrono::steady_clock;
using Kind = LidarError::Kind;

namespace {

constexpr std::size_t read_bytes = 256 * 1024;  // at most, in one go; a real lidar sends 7 kB a scan
constexpr int attempts = 3;                     // of a request that may be repeated without harm
constexpr int exchanges_wanted = 150;           // TM1 rounds of a synchronisation
constexpr auto no_deadline = steady_clock::time_point::max();

std::int64_t now_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(steady_clock::now().time_since_epoch())
      .count();
}

/// What a scan's stamp and values become for users: codes and values that are no range are 0.
Scan scan_from(const RawScan& raw, const Identity& identity) {
  Scan scan;
  scan.range_mm.reserve(raw.range_mm.size());
  const auto least = static_cast<std::uint32_t>(identity.min_range_mm),
             most = std::uint32_t{largest_range_mm(identity.max_range_mm)};
  for (const std::uint32_t range : raw.range_mm)
    scan.range_mm.push_back(range < least || range > most ? std::uint16_t{0}
                                                          : static_cast<std::uint16_t>(range));
  scan.intensity.reserve(raw.intensity.size());
  for (const std::uint32_t value : raw.intensity)
    scan.intensity.push_back(static_cast<std::uint16_t>(std::min<std::uint32_t>(value, 65535)));
  return scan;
}

}  // namespace

struct Client::Impl {
  Impl(asio::any_io_executor executor_, std::string host_, std::uint16_t port_, Options options_)
      : executor(std::move(executor_)),
        host(std::move(host_)),
        port(port_),
        options(options_),
        socket(executor),
        watchdog(std::make_shared<Watchdog>(executor)) {}
  ~Impl() { watchdog->stop(); }

  /// One timer for all deadlines, so that a deadline costs a comparison and not a timer for each read: it
  /// cancels the socket's operations once `deadline` has passed, and looks again when it was put off.
  struct Watchdog : std::enable_shared_from_this<Watchdog> {
    explicit Watchdog(const asio::any_io_executor& executor_) : timer(executor_) {}
    asio::steady_timer timer;
    tcp::socket* guarded = nullptr;
    steady_clock::time_point deadline = no_deadline;
    bool armed = false, expired = false;

    void guard(tcp::socket& what, steady_clock::time_point until) {
      guarded = &what;
      deadline = until;
      expired = false;
      if (!armed || until < timer.expiry()) arm();
    }
    void relax() { deadline = no_deadline; }
    void stop() {
      relax();
      guarded = nullptr;
      armed = false;
      timer.cancel();
    }
    void arm() {
      armed = true;
      timer.expires_at(deadline);
      timer.async_wait([self = shared_from_this()](const error_code& failed) {
        if (failed) return;  // moved to an earlier time, or stopped
        self->armed = false;
        if (self->deadline == no_deadline || !self->guarded) return;
        if (steady_clock::now() < self->deadline) return self->arm();
        self->expired = true;
        error_code ignored;
        self->guarded->cancel(ignored);
      });
    }
  };

  asio::any_io_executor executor;
  std::string host;
  std::uint16_t port;
  Options options;
  tcp::socket socket;
  tcp::endpoint peer;  ///< Of the present connection, or the last.
  std::uint16_t own_port = 0;
  std::shared_ptr<Watchdog> watchdog;
  FrameReader reader;
  Identity identity;
  Statistics statistics;
  ClockEstimator clock;
  StreamRequest request;
  std::string stream_echo, stream_tag;  ///< What a scan's echo begins and ends with.
  ScanCommand stream_command;
  Scan spare;             ///< Memory for a scan to come; what it says means nothing.
  ScanReceiver receiver;  ///< Takes what is as expected; the rest goes the long way.
  bool connected = false, streaming = false;
  unsigned requests = 0;
  int bad_in_a_row = 0;
  int repeated_in_a_row = 0;
  std::uint64_t last_scan_ms = 0;
  bool scan_seen = false;
  unsigned damaged_answers = 0;  ///< To our own requests, on this connection.
  std::string last_stray;        ///< First line and status of what came in the stream's place.
  unsigned attempts_failed = 0;  ///< To connect, in a row.
  steady_clock::time_point first_attempt{};
  std::int64_t arrived_us = 0;  ///< When the bytes of the present frame were read.

  [[nodiscard]] std::string address() const { return host + ":" + std::to_string(port); }

  void close() {
    error_code ignored;
    socket.close(ignored);
    watchdog->stop();
    reader.clear();
    connected = streaming = false;
  }

  [[noreturn]] void fail(Kind kind, const std::string& what) {
    if (kind == Kind::connection_lost) close();
    throw LidarError(kind, what);
  }

  /// What a failed read or write means. Cancellation by the caller stays what it is.
  [[noreturn]] void broken(const error_code& failed, const std::string& during) {
    if (failed == asio::error::operation_aborted && !watchdog->expired)
      throw boost::system::system_error(failed);
    fail(Kind::connection_lost, "the connection to the lidar at " + address() + " was lost while " + during +
                                    " (" + failed.message() + "). Check its power and network cable");
  }

  /// One read; returns false when the deadline passed first. Bytes read before it are kept.
  awaitable<bool> fill(steady_clock::time_point until, const char* during) {
    // Bytes that never cease would otherwise always be there before the watchdog wakes.
    if (steady_clock::now() >= until) co_return false;
    const std::span<char> room = reader.prepare(read_bytes);
    watchdog->guard(socket, until);
    error_code failed;
    const std::size_t n = co_await socket.async_read_some(asio::buffer(room.data(), room.size()),
                                                          redirect_error(use_awaitable, failed));
    watchdog->relax();
    arrived_us = now_us();
    statistics.bytes += n;
    reader.commit(n);
    if (!failed) co_return true;
    if (failed == asio::error::operation_aborted && watchdog->expired) co_return false;
    broken(failed, during);
  }

  awaitable<void> send(std::string bytes, const char* during) {
    if (!connected)
      fail(Kind::wrong_use, "not connected to the lidar at " + address() + ": call connect() first");
    watchdog->guard(socket, steady_clock::now() + options.reply_timeout);
    error_code failed;
    co_await asio::async_write(socket, asio::buffer(bytes), redirect_error(use_awaitable, failed));
    watchdog->relax();
    if (failed) broken(failed, during);
  }

  std::string next_tag() { return "r" + std::to_string(requests++ % 1000000); }

  /// What the lidar said to a request: copies, because the reader's bytes do not stay.
  struct Answer {
    Answer(std::string status_, std::string body_) : status(std::move(status_)), body(std::move(body_)) {}
    std::string status, body;
  };
  awaitable<std::optional<Answer>> answer_to(const std::string& line, steady_clock::time_point until);
  awaitable<std::optional<Answer>> exchange(Request wanted);
  awaitable<std::string> ask(Request request_);
  awaitable<void> open();
  awaitable<tcp::resolver::results_type> resolve(steady_clock::time_point until);
  awaitable<bool> falls_silent(steady_clock::time_point until);
  awaitable<void> end_stream();
  awaitable<void> leave_time_adjust();
  awaitable<Identity> identify();
  awaitable<Identity> connect();
  awaitable<Identity> connect_once();
  awaitable<void> wake();
  awaitable<Identity> connect_first();
  awaitable<Identity> reconnect();
  awaitable<void> start(StreamRequest wanted);
  awaitable<Scan> next();
  awaitable<Scan> next_to_come();
  awaitable<void> stop();
  awaitable<ClockEstimate> synchronise();
  awaitable<void> exchange_times();
  [[nodiscard]] std::string other_connection() const;
  std::optional<Scan> scan_in(const Frame& frame);
  std::optional<Scan> scan_at_hand();
  bool place_in_time(Scan& scan, std::uint32_t stamp);
  void count_repetition();
  [[nodiscard]] std::optional<Frame> scan_frame_in_wreck(std::string_view bytes) const;
  void judge_stream_status(const Frame& frame);
  void count_damage(const std::string& what);
  awaitable<void> no_scan_came();
  awaitable<std::string> state_of_lidar();
};

namespace {

/// Runs what talks to the lidar; whatever ends it, a stream that was running when it was cancelled is ended,
/// so that the laser is off.
template <class Impl, class T>
awaitable<T> ending_in_silence(Impl& impl, awaitable<T> work) {
  std::exception_ptr why;
  try {
    if constexpr (std::is_void_v<T>) {
      co_await std::move(work);
      co_return;
    } else {
      co_return co_await std::move(work);
    }
  } catch (const boost::system::system_error&) {
    why = std::current_exception();
  }
  co_await asio::this_coro::reset_cancellation_state(asio::disable_cancellation());
  if (impl.connected) {
    try {
      co_await impl.end_stream();
    } catch (const LidarError&) {  // it was to be left anyway; the caller learns of the cancellation
    }
  }
  std::rethrow_exception(why);
}

}  // namespace

// --- requests and their answers ----------------------------------------------------------------------------

/// The answer to `line` that `bytes` hold: one message, or the wreck of one with the answer inside, as when a
/// scan was cut off or the sensor spoke in the middle of one. Lines carry a string of their own, so what
/// repeats one is its answer.
std::optional<Frame> answer_in(std::string_view bytes, std::string_view line) {
  for (std::size_t at = bytes.find(line); at != std::string_view::npos; at = bytes.find(line, at + 1)) {
    const std::string_view from = bytes.substr(at);
    if (from.size() <= line.size() || from[line.size()] != '\n') continue;
    if (const auto frame = parse_frame(from)) return *frame;
  }
  return std::nullopt;
}

/// Whether what came, damaged or not, begins as the answer to that line.
bool repeats(std::string_view bytes, std::string_view line) {
  return bytes.starts_with(line) && bytes.size() > line.size() && bytes[line.size()] == '\n';
}

/// Waits for the answer that repeats `line`; others are strays. An empty optional when none came in time.
awaitable<std::optional<Client::Impl::Answer>> Client::Impl::answer_to(const std::string& line,
                                                                       steady_clock::time_point until) {
  while (true) {
    const auto frame = reader.next();
    if (frame && !frame->has_value()) {
      const bool arrived = co_await fill(until, "waiting for an answer");
      if (!arrived) co_return std::nullopt;
      continue;
    }
    if (const auto answer = answer_in(reader.last_bytes(), line))
      co_return Answer(std::string(answer->status), std::string(answer->body));
    if (!frame) {
      ++statistics.resynchronised;
      if (repeats(reader.last_bytes(), line)) {  // No better one will come.
        ++statistics.bad;
        ++damaged_answers;
        co_return std::nullopt;
      }
    } else if (streaming || (*frame)->status == "99")
      ++statistics.stale;
    else
      ++statistics.strays;
  }
}

/// Sends a request with a string of its own and waits for its answer.
awaitable<std::optional<Client::Impl::Answer>> Client::Impl::exchange(Request wanted) {
  wanted.text = next_tag();
  const std::string line = build_line(wanted);
  co_await send(line + "\n", "sending a request");
  co_return co_await answer_to(line, steady_clock::now() + options.reply_timeout);
}

/// The body of the answer to a request that may be repeated. A refusal may pass: a lidar that has just
/// started or stopped measuring refuses for a while (urg_stamped #115). Throws when it is refused every time
/// or never answered.
awaitable<std::string> Client::Impl::ask(Request request_) {
  const std::string line = build_line(request_);
  asio::steady_timer pause(executor);
  std::string refusal;
  const unsigned damaged_before = damaged_answers;
  for (int attempt = 0; attempt < attempts; ++attempt) {
    const std::optional<Answer> answer = co_await exchange(request_);
    if (!answer) continue;
    const StatusKind kind = kind_of(answer->status, request_);
    if (kind == StatusKind::done || kind == StatusKind::already) co_return answer->body;
    refusal = "the lidar at " + address() + " answered " + line + " with status " + answer->status + ": " +
              meaning_of(answer->status, request_);
    if (kind == StatusKind::hardware_fault)
      fail(Kind::hardware_fault, refusal + ". Switch it off and on; if the fault stays, it needs service");
    pause.expires_after(options.quiet);
    error_code failed;
    co_await pause.async_wait(redirect_error(use_awaitable, failed));
    if (failed) throw boost::system::system_error(failed);
  }
  const std::string times = ", asked " + std::to_string(attempts) + " times";
  if (!refusal.empty()) fail(Kind::refused, refusal + times + ". Switch it off and on if this does not pass");
  if (damaged_answers - damaged_before == attempts)
    fail(Kind::bad_answer, "the lidar at " + address() + " answered " + line + " with wrong sums" + times +
                               ". Check the network cable; connecting anew may help");
  fail(Kind::no_answer, "the lidar at " + address() + " did not answer " + line + " within " +
                            std::to_string(options.reply_timeout.count()) + " ms" + times +
                            ". Check that nothing else is connected to it, then switch it off and on");
}

// --- connecting -------------------------------------------------------------------------------------------

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
  fail(Kind::unknown_address, "the lidar's address " + host + " is not known (" +
                                  (search->result ? search->result->message() : "no name server answers") +
                                  "). Check its spelling, or give the address in numbers");
}

awaitable<void> Client::Impl::open() {
  close();
  error_code failed;
  const tcp::resolver::results_type found = co_await resolve(steady_clock::now() + options.connect_timeout);
  socket = tcp::socket(executor);
  watchdog->guard(socket, steady_clock::now() + options.connect_timeout);
  co_await asio::async_connect(socket, found, redirect_error(use_awaitable, failed));
  watchdog->relax();
  if (failed == asio::error::operation_aborted && !watchdog->expired)
    throw boost::system::system_error(failed);
  if (failed == asio::error::connection_refused)
    fail(Kind::cannot_connect, "nothing listens at " + address() + " (" + failed.message() + "), though " +
                                   host +
                                   " is reached. Check that this is the lidar's address and port (a UST-10LX "
                                   "uses 10940); one that was just switched on listens a little later");
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

/// Reads and forgets whatever comes until nothing has come for a while: the rest of a stream. False when it
/// goes on to `until`.
awaitable<bool> Client::Impl::falls_silent(steady_clock::time_point until) {
  while (steady_clock::now() < until) {
    const bool arrived =
        co_await fill(std::min(steady_clock::now() + options.quiet, until), "waiting for the stream's end");
    reader.clear();
    if (!arrived) co_return true;
  }
  co_return false;
}

/// QT until it is acknowledged and the stream is silent: real firmware now and then ignores one
/// (urg_stamped #103, #112).
awaitable<void> Client::Impl::end_stream() {
  const auto until = steady_clock::now() + options.stop_timeout;
  bool acknowledged = false;
  while (steady_clock::now() < until) {
    const std::optional<Answer> answer = co_await exchange(Request(Command::quit));
    if (!answer && damaged_answers >= attempts)
      fail(Kind::bad_answer, "the lidar at " + address() + " answers QT with wrong sums, " +
                                 std::to_string(damaged_answers) +
                                 " times. Check the network cable; connecting anew may help");
    if (!answer) continue;
    acknowledged = true;
    auto waiting = falls_silent(std::min(until, steady_clock::now() + options.reply_timeout));
    if (!co_await std::move(waiting)) continue;
    streaming = false;
    co_return;
  }
  fail(Kind::no_answer,
       "the lidar at " + address() +
           (acknowledged ? " goes on sending although it was told to stop. Switch it off and on"
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
         "the lidar at " + address() + " describes itself in a way that cannot be read: " + read.error());
  co_return *read;
}

/// Ends what an earlier host left running. A lidar that heeds no QT may heed RS, which stops it as well.
awaitable<void> Client::Impl::wake() {
  std::exception_ptr why;
  try {
    co_await end_stream();
    co_return;
  } catch (const LidarError& error) {
    if (error.kind() != Kind::no_answer || !connected) throw;
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
  std::optional<LidarError> mute;
  try {
    co_await wake();
  } catch (const LidarError& error) {
    mute = error;
  }
  if (mute && (mute->kind() == Kind::no_answer || mute->kind() == Kind::connection_lost)) {
    const bool hung_up = mute->kind() == Kind::connection_lost;
    const std::string held = other_connection();
    close();
    if (!held.empty())
      throw LidarError(Kind::in_use, "the lidar at " + address() +
                                         (hung_up ? " hangs up" : " does not answer") +
                                         " because another program of this computer is connected to it (" +
                                         held + "), and it serves one at a time. End that program first");
    throw LidarError(Kind::not_a_lidar,
                     "something listens at " + address() + (hung_up ? " but hangs up" : "") +
                         " and does not answer in SCIP. Check the address and port (a UST-10LX uses 10940), "
                         "and that no other program is connected to it");
  }
  if (mute) throw *mute;
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
                            ". Connect the first one again, or begin a new session");
  }
  ++statistics.reconnects;
  identity = again;
  co_return again;
}

// --- streaming --------------------------------------------------------------------------------------------

awaitable<void> Client::Impl::start(StreamRequest wanted) {
  if (wanted.first_step < identity.min_step || wanted.last_step > identity.max_step ||
      wanted.first_step > wanted.last_step || wanted.cluster < 1 || wanted.cluster > 99 || wanted.skip < 0 ||
      wanted.skip > 9)
    fail(Kind::wrong_use,
         "steps " + std::to_string(wanted.first_step) + " to " + std::to_string(wanted.last_step) +
             " in clusters of " + std::to_string(wanted.cluster) + ", skipping " +
             std::to_string(wanted.skip) + ": this lidar has steps " + std::to_string(identity.min_step) +
             " to " + std::to_string(identity.max_step) + ", clusters of 1 to 99 and skips of 0 to 9");
  if (streaming) co_await stop();
  request = wanted;
  stream_command = ScanCommand();
  stream_command.format = wanted.with_intensity ? ScanFormat::distance_intensity : ScanFormat::distance3;
  stream_command.first_step = wanted.first_step;
  stream_command.last_step = wanted.last_step;
  stream_command.cluster = wanted.cluster;
  stream_command.skip = wanted.skip;
  const Request asked(stream_command);
  for (int attempt = 0; attempt < attempts; ++attempt) {
    const std::optional<Answer> answer = co_await exchange(asked);
    if (!answer) {  // it may stream all the same: end it before asking again
      co_await end_stream();
      continue;
    }
    const StatusKind kind = kind_of(answer->status, asked);
    if (kind == StatusKind::scan_data) {  // it streams, but its acknowledgement was spoilt on the way
      co_await end_stream();
      continue;
    }
    const bool is_refused = kind != StatusKind::done && kind != StatusKind::already;
    if (answer->status == "0E" || answer->status == "0F")
      fail(Kind::unknown_command,
           "the lidar at " + address() + " does not know " + build_line(asked).substr(0, 2) + " (status " +
               answer->status + ": " + meaning_of(answer->status, asked) + "). " +
               (wanted.with_intensity ? "It sends no intensities: ask for distances alone"
                                      : "It sends no continuous scans, so that this driver cannot use it"));
    if (is_refused && kind != StatusKind::hardware_fault && attempt + 1 < attempts) {
      co_await end_stream();  // Whatever state it is in, QT leads out of it.
      continue;
    }
    if (is_refused)
      fail(kind == StatusKind::hardware_fault ? Kind::hardware_fault : Kind::refused,
           "the lidar at " + address() + " will not measure: status " + answer->status + ", " +
               meaning_of(answer->status, asked) + ". Switch it off and on if this does not pass");
    stream_tag = ";r" + std::to_string((requests + 999999) % 1000000);
    receiver =
        ScanReceiver(stream_command, stream_tag.substr(1), identity.min_range_mm, identity.max_range_mm);
    stream_echo = build_line(asked);
    stream_echo.resize(stream_echo.size() - 2);  // the number of scans that remain changes
    streaming = true;
    bad_in_a_row = repeated_in_a_row = 0;
    scan_seen = false;
    last_stray.clear();
    clock.begin_stream();
    co_return;
  }
  fail(Kind::no_answer, "the lidar at " + address() + " did not answer the request to measure");
}

void Client::Impl::count_damage(const std::string& what) {
  ++statistics.bad;
  if (++bad_in_a_row < options.max_bad_scans) return;
  fail(Kind::bad_answer, std::to_string(bad_in_a_row) + " scans in a row from the lidar at " + address() +
                             " arrived damaged (the last: " + what +
                             "). Check the network cable; reconnecting may help");
}

/// A message of the stream that is not a scan: a check of itself, or a fault.
void Client::Impl::judge_stream_status(const Frame& frame) {
  const Request asked(stream_command);
  const StatusKind kind = kind_of(frame.status, asked);
  last_stray = "status " + std::string(frame.status) + ", " + meaning_of(frame.status, asked);
  if (kind != StatusKind::hardware_fault) return;  // checking and resumed: wait on
  streaming = false;
  fail(Kind::hardware_fault, "the lidar at " + address() + " stopped measuring: status " +
                                 std::string(frame.status) + ", " + meaning_of(frame.status, asked) +
                                 ". Switch it off and on; if the fault stays, it needs service");
}

/// The last scan in a message that lost its beginning, or its end to the next: one loss should not cost two.
std::optional<Frame> Client::Impl::scan_frame_in_wreck(std::string_view bytes) const {
  const std::size_t at = bytes.rfind(stream_echo);
  if (at == std::string_view::npos || at == 0) return std::nullopt;
  const auto frame = parse_frame(bytes.substr(at));
  return frame ? std::optional(*frame) : std::nullopt;
}

/// The scan that a message of this stream carries; nothing for any other message.
std::optional<Scan> Client::Impl::scan_in(const Frame& frame) {
  const bool ours = frame.echo.starts_with(stream_echo) && frame.echo.ends_with(stream_tag) &&
                    frame.echo.size() == stream_echo.size() + 2 + stream_tag.size();
  if (!ours) {
    const bool a_scan = frame.status == "99";
    ++(a_scan ? statistics.stale : statistics.strays);
    last_stray = "an answer to " + std::string(frame.echo.substr(0, 40)) + ", which was not asked for";
    return std::nullopt;
  }
  if (kind_of(frame.status, Request(stream_command)) != StatusKind::scan_data) {
    judge_stream_status(frame);
    return std::nullopt;
  }
  auto raw = decode_scan(frame.body, stream_command);
  if (!raw) {
    count_damage(std::string(to_string(raw.error())));
    const auto inner = scan_frame_in_wreck(frame.body);
    return inner ? scan_in(*inner) : std::nullopt;
  }
  Scan scan = scan_from(*raw, identity);
  if (!place_in_time(scan, static_cast<std::uint32_t>(raw->stamp & 0xFFFFFF))) return std::nullopt;
  return scan;
}

/// A scan whose stamp is not later than that of the one before is the same again, or one from before.
void Client::Impl::count_repetition() {
  ++statistics.repeated;
  if (++repeated_in_a_row < options.max_bad_scans) return;
  fail(Kind::bad_answer,
       "the time stamps of " + std::to_string(repeated_in_a_row) + " scans in a row from the lidar at " +
           address() +
           " do not advance: its timer stands or was set back, or it repeats itself. None of them "
           "was delivered. Connect anew; switch it off and on if this does not pass");
}

/// Completes a good scan with what is known of it beside its values, and counts it; false when it is a
/// repetition.
bool Client::Impl::place_in_time(Scan& scan, std::uint32_t stamp) {
  bad_in_a_row = 0;
  scan.first_step = request.first_step;
  scan.last_step = request.last_step;
  scan.cluster = request.cluster;
  scan.device_ms = clock.unwrap(stamp, static_cast<double>(arrived_us));
  if (scan_seen && scan.device_ms <= last_scan_ms) {
    count_repetition();
    return false;
  }
  repeated_in_a_row = 0;
  scan.host_us = static_cast<std::int64_t>(
      std::llround(clock.add_scan(scan.device_ms, static_cast<double>(arrived_us))));
  if (scan_seen) {
    const double period_ms = identity.scan_period_s * 1000 * (request.skip + 1);
    const auto passed = std::llround(static_cast<double>(scan.device_ms - last_scan_ms) / period_ms);
    if (passed > 1) statistics.lost += static_cast<std::uint64_t>(passed - 1);
  }
  scan_seen = true;
  last_scan_ms = scan.device_ms;
  ++statistics.scans;
  return true;
}

/// The next scan in the waiting bytes, for as long as they are as expected.
std::optional<Scan> Client::Impl::scan_at_hand() {
  std::optional<Scan> scan(std::move(spare));
  while (const auto stamp = receiver.take(reader.waiting(), *scan)) {
    reader.consume(receiver.message_bytes());
    if (place_in_time(*scan, *stamp)) return scan;
  }
  spare = std::move(*scan);
  return std::nullopt;
}

/// Most scans of a fast stream came with the one before: those take neither the clock nor a wait.
awaitable<Scan> Client::Impl::next() {
  if (!streaming) fail(Kind::wrong_use, "no stream runs: call start() first");
  if (std::optional<Scan> scan = scan_at_hand()) co_return std::move(*scan);
  co_return co_await ending_in_silence(*this, next_to_come());
}

awaitable<Scan> Client::Impl::next_to_come() {
  const auto until = steady_clock::now() + options.scan_timeout;
  while (true) {
    if (std::optional<Scan> scan = scan_at_hand()) co_return std::move(*scan);
    const auto frame = reader.next();
    if (!frame) {
      ++statistics.resynchronised;
      count_damage(std::string(to_string(frame.error())));
      if (const auto whole = scan_frame_in_wreck(reader.last_bytes()))
        if (std::optional<Scan> scan = scan_in(*whole)) co_return std::move(*scan);
    } else if (frame->has_value()) {
      if (std::optional<Scan> scan = scan_in(**frame)) co_return std::move(*scan);
    } else {
      const bool arrived = co_await fill(until, "waiting for a scan");
      if (!arrived) co_await no_scan_came();
    }
  }
}

/// What a lidar that sends nothing says of itself, to be read behind "; ".
awaitable<std::string> Client::Impl::state_of_lidar() {
  const std::optional<Answer> answer = co_await exchange(Request(Command::information));
  if (!answer) co_return "it does not answer questions either";
  const auto values = decode_key_values(answer->body);
  if (!values || values->empty()) co_return "asked how it is, it answers with status " + answer->status;
  co_return "asked how it is, it says laser " + value_of(*values, "LASR") + ", " + value_of(*values, "MESM") +
      ", " + value_of(*values, "STAT");
}

awaitable<void> Client::Impl::no_scan_came() {
  const std::string limit = std::to_string(options.scan_timeout.count()) + " ms";
  if (bad_in_a_row > 0)
    fail(Kind::bad_answer, "only damaged scans (" + std::to_string(bad_in_a_row) +
                               ") arrived from the lidar at " + address() + " in " + limit +
                               ". Check the network cable; reconnecting may help");
  std::string what = "the lidar at " + address() + " sent no scan for " + limit;
  if (!last_stray.empty()) what += "; the last it sent was " + last_stray;
  const std::string state = co_await state_of_lidar();
  what += "; " + state;
  fail(Kind::no_answer, what + ". Check its power and network cable; connecting anew may help");
}

awaitable<void> Client::Impl::stop() {
  if (!streaming || !connected) co_return;
  co_await end_stream();
}

// --- the clock --------------------------------------------------------------------------------------------

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
