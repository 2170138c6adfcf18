// SPDX-License-Identifier: MIT
#include "rig/runner/operators.hpp"

#include <unistd.h>

#include <algorithm>
#include <boost/algorithm/string/predicate.hpp>
#include <boost/asio/buffer.hpp>
#include <boost/asio/connect.hpp>
#include <boost/asio/experimental/awaitable_operators.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/read_until.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/this_coro.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/asio/write.hpp>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "rig/errors.hpp"

namespace rig {
namespace {

namespace asio = boost::asio;
using asio::awaitable;
using asio::use_awaitable;
using nlohmann::json;
using namespace asio::experimental::awaitable_operators;

constexpr auto bench_deadline = std::chrono::seconds(5);
constexpr std::size_t longest_line = 64 * 1024;

class RealClock final : public RunClock {
 public:
  std::int64_t host_us() const override {
    return std::chrono::duration_cast<std::chrono::microseconds>(
               std::chrono::steady_clock::now().time_since_epoch())
        .count();
  }
  std::int64_t unix_us() const override {
    return std::chrono::duration_cast<std::chrono::microseconds>(
               std::chrono::system_clock::now().time_since_epoch())
        .count();
  }
  awaitable<void> sleep(double seconds) override {
    asio::steady_timer timer(co_await asio::this_coro::executor);
    constexpr double longest_s = 1e9;  // 30 years; the timer's nanoseconds overflow at 290.
    timer.expires_after(std::chrono::microseconds(std::llround(std::clamp(seconds, 0.0, longest_s) * 1e6)));
    co_await timer.async_wait(use_awaitable);
  }
};

class AbsentOperator final : public Operator {
 public:
  awaitable<Answer> ask(Prompt prompt) override {
    if (prompt.question && !prompt.question->otherwise)
      throw UsageError("'" + prompt.title + "' asks for " + prompt.question->name +
                       " and has no default, so it cannot be answered by --yes. Give the question a default "
                       "in the procedure, or stay and answer.");
    co_return Answer{};
  }
  bool unattended() const override { return true; }
};

class BenchOperator final : public Operator {
 public:
  BenchOperator(const asio::any_io_executor& executor, Endpoint address)
      : address_(std::move(address)), socket_(executor) {}

  awaitable<Answer> ask(Prompt prompt) override {
    if (!prompt.place) co_return Answer{};
    std::string line = json{{"place", to_json(*prompt.place)}}.dump() + "\n", answer;
    std::exception_ptr why;
    auto asking = exchange_quietly(std::move(line), answer, why);
    auto late = deadline();
    const auto outcome = co_await (std::move(asking) || std::move(late));
    if (outcome.index() == 1) {
      forget_connection();
      throw DeviceError("The simulated bench at " + name() +
                        " did not answer within 5 s. Nothing was placed. Start rig-sim again.");
    }
    if (why) std::rethrow_exception(why);
    const json said = json::parse(answer, nullptr, false);
    if (!said.is_object() || !said.value("ok", false))
      throw MeasurementError("The simulated bench cannot do '" + prompt.title + "': " +
                             (said.is_object()
                                  ? said.value("error", "no reason given")
                                  : "its answer is not understood: is this rig-sim's operator port?"));
    co_return Answer{};
  }
  bool unattended() const override { return true; }

 private:
  std::string name() const { return address_.host + ":" + std::to_string(address_.port); }

  void forget_connection() {
    boost::system::error_code ignored;
    socket_.close(ignored);
    received_.clear();
  }

  static awaitable<void> deadline() {
    asio::steady_timer timer(co_await asio::this_coro::executor);
    timer.expires_after(bench_deadline);
    co_await timer.async_wait(use_awaitable);
  }

  /// exchange() with its failure as a value: `||` goes on waiting when one side throws.
  awaitable<void> exchange_quietly(std::string line, std::string& answer, std::exception_ptr& why) {
    try {
      answer = co_await exchange(std::move(line));
    } catch (...) {
      why = std::current_exception();
    }
  }

  awaitable<std::string> exchange(std::string line) {
    try {
      if (!socket_.is_open()) {
        asio::ip::tcp::resolver resolver(socket_.get_executor());
        const auto found =
            co_await resolver.async_resolve(address_.host, std::to_string(address_.port), use_awaitable);
        co_await asio::async_connect(socket_, found, use_awaitable);
      }
      co_await asio::async_write(socket_, asio::buffer(line), use_awaitable);
      const std::size_t length = co_await asio::async_read_until(
          socket_, asio::dynamic_buffer(received_, longest_line), '\n', use_awaitable);
      std::string answer = received_.substr(0, length);
      received_.erase(0, length);
      co_return answer;
    } catch (const boost::system::system_error& error) {
      if (error.code() == asio::error::operation_aborted) throw;
      forget_connection();
      throw DeviceError("The simulated bench's operator port " + name() + " cannot be used (" +
                        error.code().message() +
                        "). Nothing was placed. Give the operator address that "
                        "rig-sim printed.");
    }
  }

  Endpoint address_;
  asio::ip::tcp::socket socket_;
  std::string received_;
};

class TerminalOperator final : public Operator {
 public:
  TerminalOperator(const asio::any_io_executor& executor, bool others_answer)
      : input_(executor), others_answer_(others_answer) {
    boost::system::error_code error;
    input_.assign(::dup(STDIN_FILENO), error);  // Fails for files, which cannot be waited for.
    ended_ = static_cast<bool>(error);
  }

  awaitable<Answer> ask(Prompt prompt) override {
    say(prompt);
    while (true) {
      const std::string line = co_await read_line();
      if (const auto answer = answer_in(line, prompt)) co_return *answer;
      std::fprintf(
          stderr,
          "  Not understood. Enter: done; s: skip; r: repeat the last one; a or q: stop the run.\n> ");
    }
  }
  bool unattended() const override { return false; }

 private:
  static void say(const Prompt& prompt) {
    std::string text = "\n== " + prompt.title + "\n";
    if (!prompt.text.empty()) text += "   " + prompt.text + "\n";
    if (!prompt.picture.empty()) text += "   Picture: " + prompt.picture + "\n";
    if (const std::string& wrong = prompt.refusal.empty() ? prompt.check : prompt.refusal; !wrong.empty())
      text += "   Not yet: " + wrong + "\n";
    if (prompt.question) {
      const Question& question = *prompt.question;
      text += "   Type " + question.name + (question.unit.empty() ? "" : " in " + question.unit);
      if (question.min && question.max)
        text += ", " + to_text(*question.min) + " to " + to_text(*question.max);
      if (question.otherwise) text += " [" + to_text(*question.otherwise) + "]";
      text += ", and press Enter";
    } else {
      text += "   Press Enter when it is done";
    }
    text += prompt.skippable ? "; s skips" : "";
    text += prompt.repeatable ? "; r repeats the last one" : "";
    text += "; a or q stops the run.\n> ";
    std::fputs(text.c_str(), stderr);
  }

  static std::optional<Answer> answer_in(std::string line, const Prompt& prompt) {
    const auto first = line.find_first_not_of(" \t\r\n");
    line = first == std::string::npos ? "" : line.substr(first, line.find_last_not_of(" \t\r\n") - first + 1);
    const auto is = [&](std::initializer_list<const char*> words) {
      return std::ranges::any_of(words, [&](const char* word) { return boost::iequals(line, word); });
    };
    Answer answer;
    if (line.empty() || (is({"y", "yes", "done", "ok"}) && !prompt.question)) return answer;
    if (is({"s", "skip"}) && prompt.skippable) answer.kind = Answer::Kind::skipped;
    if (is({"r", "repeat"}) && prompt.repeatable) answer.kind = Answer::Kind::repeat;
    if (is({"a", "q", "abort", "quit", "stop"})) answer.kind = Answer::Kind::abort;
    if (answer.kind != Answer::Kind::confirmed) return answer;
    if (!prompt.question) return std::nullopt;
    answer.value = value_of_text(line);
    return answer;
  }

  awaitable<std::string> read_line() {
    boost::system::error_code error;
    std::size_t length = 0;
    if (!ended_)
      length = co_await asio::async_read_until(input_, asio::dynamic_buffer(typed_, longest_line), '\n',
                                               asio::redirect_error(use_awaitable, error));
    if (error == asio::error::operation_aborted) throw boost::system::system_error(error);
    if (error || ended_) {
      ended_ = true;
      if (!others_answer_)
        throw UsageError(
            "Nobody can answer: standard input has ended. Give --yes to confirm all prompts, --operator for "
            "a simulated bench, or --live to answer in a browser.");
      asio::steady_timer never(input_.get_executor(), asio::steady_timer::time_point::max());
      co_await never.async_wait(use_awaitable);
    }
    std::string line = typed_.substr(0, length);
    typed_.erase(0, length);
    co_return line;
  }

  asio::posix::stream_descriptor input_;
  std::string typed_;
  bool others_answer_, ended_ = false;
};

}  // namespace

std::unique_ptr<RunClock> make_real_clock() { return std::make_unique<RealClock>(); }
std::unique_ptr<Operator> make_absent_operator() { return std::make_unique<AbsentOperator>(); }
std::unique_ptr<Operator> make_bench_operator(const asio::any_io_executor& executor,
                                              const Endpoint& address) {
  return std::make_unique<BenchOperator>(executor, address);
}
std::unique_ptr<Operator> make_terminal_operator(const asio::any_io_executor& executor, bool others_answer) {
  return std::make_unique<TerminalOperator>(executor, others_answer);
}

}  // namespace rig
