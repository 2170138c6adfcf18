// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/awaitable.hpp>
#include <exception>
#include <optional>

#include "rig/runner/gate.hpp"
#include "rig/runner/runner.hpp"

namespace rig {

/// Where the answer to a prompt comes in, from whoever gives it first: the terminal, the bench, the live
/// page. Between two prompts it takes none.
class AnswerDesk {
 public:
  AnswerDesk(Operator& asked, RunClock& clock) : operator_(asked), clock_(clock) {}

  /// Forgets the answer before; then answers are taken.
  void open();
  /// An answer from elsewhere than the operator.
  void answer(const Answer& given);
  /// The run is stopped: nobody waits any more.
  void close() { elsewhere_.open(); }
  /// An answer is there, or the operator failed.
  [[nodiscard]] bool is_over() const { return answered_ || operator_failed_; }

  /// Asks the operator, with `watching` beside; returns when an answer is there from anywhere, in vain after
  /// the prompt's own time, or when `watching` ends.
  boost::asio::awaitable<void> wait(Prompt prompt, boost::asio::awaitable<void> watching);
  /// What was answered, if anything; throws why the operator failed.
  [[nodiscard]] std::optional<Answer> taken();

 private:
  boost::asio::awaitable<void> ask_operator(Prompt prompt);
  boost::asio::awaitable<void> sleep(double seconds);

  Operator& operator_;
  RunClock& clock_;
  std::optional<Answer> answered_;
  Gate elsewhere_;
  std::exception_ptr operator_failed_;
};

/// Waits until it is called off.
boost::asio::awaitable<void> never();

}  // namespace rig
