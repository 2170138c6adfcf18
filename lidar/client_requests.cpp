// SPDX-License-Identifier: MIT
// Requests and their answers, over the socket.
#include <array>
#include <boost/asio/write.hpp>

#include "lidar/client_impl.hpp"
#include "lidar/status.hpp"

namespace lidar {
namespace {

constexpr std::size_t read_bytes = 256 * 1024;  // at most, in one go; a real lidar sends 7 kB a scan

/// The answer to `line` that `bytes` hold: one message, or a damaged one with the answer inside, as when a
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

}  // namespace

/// What a failed read or write means. Cancellation by the caller stays what it is.
void Client::Impl::broken(const error_code& failed, const std::string& during) {
  if (failed == asio::error::operation_aborted && !watchdog->expired)
    throw boost::system::system_error(failed);
  fail(Kind::connection_lost, "the connection to the lidar at " + address() + " was lost while " + during +
                                  " (" + failed.message() + "). Check its power and network cable");
}

/// One read; returns false when the deadline passed first. Bytes read before it are kept.
awaitable<bool> Client::Impl::fill(steady_clock::time_point until, const char* during) {
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

awaitable<void> Client::Impl::send(std::string bytes, const char* during) {
  if (!connected)
    fail(Kind::wrong_use, "not connected to the lidar at " + address() + ": call connect() first");
  watchdog->guard(socket, steady_clock::now() + options.reply_timeout);
  error_code failed;
  co_await asio::async_write(socket, asio::buffer(bytes), redirect_error(use_awaitable, failed));
  watchdog->relax();
  if (failed) broken(failed, during);
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
      fail(Kind::hardware_fault, refusal + ". Switch it off and on; if the fault persists, it needs service");
    pause.expires_after(options.quiet);
    error_code failed;
    co_await pause.async_wait(redirect_error(use_awaitable, failed));
    if (failed) throw boost::system::system_error(failed);
  }
  const std::string times = ", asked " + std::to_string(attempts) + " times";
  if (!refusal.empty()) fail(Kind::refused, refusal + times + ". Switch it off and on if this persists");
  if (damaged_answers - damaged_before == attempts)
    fail(Kind::bad_answer, "the lidar at " + address() + " answered " + line + " with wrong checksums" +
                               times + ". Check the network cable; reconnecting may help");
  fail(Kind::no_answer, "the lidar at " + address() + " did not answer " + line + " within " +
                            std::to_string(options.reply_timeout.count()) + " ms" + times +
                            ". Check that nothing else is connected to it, then switch it off and on");
}

}  // namespace lidar
