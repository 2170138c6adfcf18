// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <boost/asio/awaitable.hpp>
#include <chrono>
#include <memory>
#include <optional>
#include <string>

#include "rig/errors.hpp"

namespace rig {

/// A serial line, read by lines. Real ports are opened through libserialport; pseudo-terminals and whatever
/// else the kernel does not list as a port are opened directly. A path may be a symbolic link
/// (/dev/serial/by-id/...).
///
/// What came instead of an answer is kept to be shown: a wrong baud rate or another device is not silence.
///
/// Bytes that arrived stay in the link's own buffer when a wait times out or is cancelled. Use it on one
/// thread.
class SerialLink {
 public:
  using Clock = std::chrono::steady_clock;
  template <class T>
  using awaitable = boost::asio::awaitable<T>;

  /// Opens `path` exclusively at 8N1. Throws StageError saying what is wrong and what to do: not there, no
  /// permission, in use, not a serial port, a baud rate it does not have.
  SerialLink(const boost::asio::any_io_executor& executor, std::string path, int baud,
             bool hardware_flow_control);
  ~SerialLink();
  SerialLink(const SerialLink&) = delete;
  SerialLink& operator=(const SerialLink&) = delete;

  [[nodiscard]] const std::string& path() const;
  /// The open port; -1 when it is lost.
  [[nodiscard]] int descriptor() const;
  [[nodiscard]] int baud() const;
  /// Closes the port and opens it again by its name; throws as the constructor does, but says that the stage
  /// may still turn.
  void reopen();

  /// Throws StageLost when the port is gone or does not take the bytes by the deadline.
  awaitable<void> write(std::string bytes, Clock::time_point deadline);
  /// Hands over what the line takes at once, for commands that must not wait their turn; never throws.
  void write_now(const std::string& bytes) noexcept;
  /// The next line that is not empty, without its CR or LF; nothing if none came whole by the deadline. Lines
  /// longer than `longest_line` are noise and are dropped. Throws StageLost when the port is gone.
  awaitable<std::optional<std::string>> read_line(Clock::time_point deadline);
  /// Drops what has arrived.
  void discard() noexcept;
  /// Drops what has arrived and reads on until the line has been quiet for `silence`, for at most five times
  /// as long.
  awaitable<void> drain();

  /// Asks in a language whose answers only their order tells apart: what came before is dropped, and if
  /// answers were forgotten, silence is awaited first. Returns when the answer is due, `reply_s` from the
  /// question. Throws as write() does.
  awaitable<Clock::time_point> ask(std::string question, double reply_s);
  /// An answer may still come to a question that nobody waits for any more; so it is on a port just opened.
  void forget_answers() noexcept;

  /// Forgets what heard() tells: a new question is asked.
  void listen_anew() noexcept;
  /// The first bytes that came since listen_anew(), understood or not.
  [[nodiscard]] const std::string& heard() const;
  /// A question had no answer that the language knows: silence, which `check` says the remedy of, or
  /// something else, which is shown.
  [[nodiscard]] StageLost unanswered(const std::string& question, int attempts,
                                     const std::string& check) const;

  static constexpr std::size_t longest_line = 1024;
  static constexpr auto silence = std::chrono::milliseconds(20);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Bytes in quotes for a message: what is not printable as \x81, at most 24 bytes of them.
[[nodiscard]] std::string shown_bytes(const std::string& bytes);

}  // namespace rig
