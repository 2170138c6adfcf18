// SPDX-License-Identifier: MIT
#include "rig/runner/answer_desk.hpp"

#include <boost/asio/experimental/awaitable_operators.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/this_coro.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <utility>

namespace rig {
namespace {

using boost::asio::awaitable;
using namespace boost::asio::experimental::awaitable_operators;

}  // namespace

awaitable<void> never() {
  boost::asio::steady_timer timer(co_await boost::asio::this_coro::executor,
                                  boost::asio::steady_timer::time_point::max());
  co_await timer.async_wait(boost::asio::use_awaitable);
}

void AnswerDesk::open() {
  answered_.reset();
  elsewhere_.close();
}

void AnswerDesk::answer(const Answer& given) {
  answered_ = given;
  elsewhere_.open();
}

awaitable<void> AnswerDesk::wait(Prompt prompt, awaitable<void> watching) {
  auto asking = ask_operator(prompt);
  auto elsewhere = elsewhere_.wait();
  auto late = prompt.timeout_s > 0 ? sleep(prompt.timeout_s) : never();
  co_await (std::move(asking) || std::move(elsewhere) || std::move(late) || std::move(watching));
}

std::optional<Answer> AnswerDesk::taken() {
  if (operator_failed_) std::rethrow_exception(std::exchange(operator_failed_, nullptr));
  return answered_;
}

awaitable<void> AnswerDesk::ask_operator(Prompt prompt) {
  try {
    const Answer given = co_await operator_.ask(prompt);
    if (!answered_) answered_ = given;
  } catch (const boost::system::system_error& error) {
    // Called off, because the answer came from elsewhere or none came in time, is no failure.
    if (!answered_ && error.code() != boost::asio::error::operation_aborted)
      operator_failed_ = std::current_exception();
  } catch (...) {
    if (!answered_) operator_failed_ = std::current_exception();
  }
}

awaitable<void> AnswerDesk::sleep(double seconds) { co_await clock_.sleep(seconds); }

}  // namespace rig
