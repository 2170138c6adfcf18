// SPDX-License-Identifier: MIT
// What this project's coroutines rest on: which temporaries of a co_await expression the compiler destroys
// once. g++ 12 destroys aggregates in braces, capturing lambdas and the sides of ?: twice
// (docs/develop/decisions/gcc12.md); all that is here is right.
#include <boost/asio/awaitable.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/io_context.hpp>
#include <catch2/catch.hpp>
#include <exception>
#include <functional>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

namespace coroutine_test {
namespace {

template <class T>
using awaitable = boost::asio::awaitable<T>;

/// Counts those alive: below zero where one is destroyed twice.
struct Counted {
  static inline int alive = 0;
  std::string text = "longer than what a string keeps in place";
  Counted() { ++alive; }
  Counted(const Counted& other) : text(other.text) { ++alive; }
  Counted(Counted&& other) noexcept : text(std::move(other.text)) { ++alive; }
  Counted& operator=(const Counted&) = default;
  Counted& operator=(Counted&&) = default;
  ~Counted() { --alive; }
};

/// An aggregate as they are passed to coroutines: a variable of it may be copied and moved into one.
struct Several {
  int number = 1;
  Counted counted;
};

awaitable<int> take(Counted given) { co_return static_cast<int>(given.text.size()); }
awaitable<int> take_several(Several given) {
  co_return given.number + static_cast<int>(given.counted.text.size());
}
awaitable<int> take_text(const std::string& given) { co_return static_cast<int>(given.size()); }
awaitable<int> take_optional(std::optional<Counted> given) { co_return given ? 1 : 0; }
awaitable<int> take_function(std::function<int()> given) { co_return given(); }
awaitable<int> fail(Counted given, const std::string& why) {
  co_await take(given);
  throw std::runtime_error(why);
}
Several several() { return {}; }

/// Runs it to its end and tells how many objects it left alive (or destroyed too often).
template <class Work>
int left_alive(Work work) {
  const int before = Counted::alive;
  {
    boost::asio::io_context io;
    std::exception_ptr failure;
    boost::asio::co_spawn(io, work(), [&](std::exception_ptr why) { failure = why; });
    io.run();
    if (failure) std::rethrow_exception(failure);
  }
  return Counted::alive - before;
}

// Not CHECK(co_await ...): Catch lets the compiler look at an expression twice, and g++ 12 then waits twice.
awaitable<void> objects() {
  const int got_1 = co_await take(Counted());
  CHECK(got_1 == 40);
  const int got_2 = co_await take_optional(Counted());
  CHECK(got_2 == 1);
  const int got_3 = co_await take_optional(std::nullopt);
  CHECK(got_3 == 0);
  const int got_4 = co_await take_text(std::string(20, 'a') + "b");
  CHECK(got_4 == 21);
  const int sum = co_await take(Counted()) + co_await take(Counted());
  CHECK(sum == 80);
}

awaitable<void> variables() {
  Several one, two;
  const std::function<int()> seven = [] { return 7; };
  const int got_5 = co_await take_several(one);
  CHECK(got_5 == 41);
  const int got_6 = co_await take_several(std::move(two));
  CHECK(got_6 == 41);
  const int got_7 = co_await take_several(several());
  CHECK(got_7 == 41);
  const int got_8 = co_await take_function(seven);
  CHECK(got_8 == 7);
}

awaitable<void> errors() {
  const std::string why = "because of ";
  bool failed = false;
  try {
    co_await fail(Counted(), why + "a reason that is long enough");
  } catch (const std::runtime_error&) {
    failed = true;
  }
  CHECK(failed);
}

}  // namespace

TEST_CASE("temporaries of a co_await expression are destroyed once: objects, variables, and beside errors") {
  CHECK(left_alive(objects) == 0);
  CHECK(left_alive(variables) == 0);
  CHECK(left_alive(errors) == 0);
}

}  // namespace coroutine_test
