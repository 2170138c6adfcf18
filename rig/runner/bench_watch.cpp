// SPDX-License-Identifier: MIT
#include "rig/runner/bench_watch.hpp"

#include <algorithm>

#include "rig/runner/echoes.hpp"
#include "rig/runner/failures.hpp"

namespace rig {
namespace {

using boost::asio::awaitable;

constexpr double between_attempts_s = 2;
// Of a device that sends as fast as it is read: two checks a second are enough for an eye.
constexpr double between_checks_s = 0.5;

bool is_cancellation(const std::exception_ptr& why) {
  try {
    std::rethrow_exception(why);
  } catch (const boost::system::system_error& error) {
    return error.code() == boost::asio::error::operation_aborted;
  } catch (...) {
    return false;
  }
}

}  // namespace

awaitable<void> BenchWatch::watch(std::optional<Expectation> until) {
  const bool is_attended = !operator_.unattended() && lidar_.connected();
  bool lost = false;
  while (is_attended) {
    std::exception_ptr why;
    try {
      if (lost) {
        co_await lidar_.reconnect_once();
        lost = false;
      }
      co_await watch_stream(until);
    } catch (...) {
      why = std::current_exception();
    }
    // The driver has reset the cancellation state for its last words to the device: only the exception tells.
    if (is_cancellation(why) || desk_.is_over() || control_.aborted()) co_return;
    if (!lost)
      status_.note("warning",
                   "lidar lost: " + words_of(why) + " Check its power and cable; rig keeps trying.");
    lost = true;
    lidar_.lost();
    show(Observation(false, "the lidar does not answer."));
    status_.changed();
    co_await clock_.sleep(between_attempts_s);
  }
  co_await never();
}

awaitable<void> BenchWatch::watch_stream(std::optional<Expectation> until) {
  const CaptureRequest wanted = until ? beams_of(*until, geometry_) : CaptureRequest();
  const auto beams = static_cast<std::size_t>(until ? wanted.last_step - wanted.first_step + 1 : 0);
  while (true) {
    co_await lidar_.start_to_watch(whole_scan(geometry_));
    Echoes echoes(beams);
    bool enough = false;
    while (!enough) {
      const lidar::Scan scan = co_await lidar_.source().next();
      lidar_.show(scan);
      echoes.add(scan, static_cast<std::size_t>(std::max(0, wanted.first_step - scan.first_step)));
      if (echoes.enough()) {
        if (until) show(observer_.judge(*until, wanted.first_step, echoes.seen()));
        echoes = Echoes(beams);
        enough = time_.follows_lidar();
      }
      status_.changed();
    }
    co_await lidar_.end();
    co_await clock_.sleep(between_checks_s);
  }
}

void BenchWatch::show(const Observation& observed) {
  auto& prompt = status_.state().prompt;
  if (!prompt) return;
  prompt->check = observed.good ? "" : observed.text;
  prompt->seen = observed.good ? observed.text : "";
  prompt->to_go_mm = observed.to_go_mm;
}

awaitable<void> BenchWatch::end() {
  std::exception_ptr why;
  try {
    co_await lidar_.end();
  } catch (...) {
    why = std::current_exception();
  }
  // The next step connects anew.
  if (why) status_.note("warning", "lidar lost: " + words_of(why));
}

}  // namespace rig
