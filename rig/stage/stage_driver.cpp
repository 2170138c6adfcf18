// SPDX-License-Identifier: MIT
#include "rig/stage/stage_driver.hpp"

#include <algorithm>
#include <array>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <exception>
#include <utility>
#include <vector>

#include "rig/stage/stage_guard.hpp"

namespace rig {

namespace asio = boost::asio;
using asio::awaitable;
using Clock = std::chrono::steady_clock;

namespace {

constexpr double first_poll_s = 0.001,
                 longest_poll_s = 0.05;  // polled ever more slowly: short moves are noticed soon
constexpr double no_progress_s = 5;      // says that it moves, but the position has not changed for so long
constexpr double first_return_s = 0.3, longest_return_s = 2;  // how long a lost port may take to come back
constexpr double longest_stop_s = 10;                         // from full speed at a gentle deceleration
constexpr double longest_turn_s = 30;  // for the line: far beyond any command with all its repetitions
constexpr auto beat_interval = std::chrono::seconds(1);
const std::string stopping = "stopping";
constexpr int most_reads = 6;  // to see the same position twice

Clock::duration duration(double seconds) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

std::string text_of(double number) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.7g", std::round(number * 1e4) / 1e4);
  return text.data();
}

std::string in_deg(double deg) { return text_of(deg) + " deg"; }

}  // namespace

StageIdentity printable(StageIdentity identity) {
  for (std::string* text : {&identity.model, &identity.serial, &identity.firmware})
    std::ranges::replace_if(
        *text, [](char c) { return c < ' ' || c > '~'; }, '?');
  return identity;
}

struct StageDriver::Line {
  bool taken = false;
  std::vector<asio::steady_timer*> waiting;
};

struct StageDriver::Heartbeat : std::enable_shared_from_this<StageDriver::Heartbeat> {
  explicit Heartbeat(const asio::any_io_executor& executor) : timer(executor) {}

  void beat() {
    is_moving = true;
    if (guard) guard->moving();
    timer.expires_after(beat_interval);
    timer.async_wait([weak = weak_from_this()](const boost::system::error_code& stopped) {
      const auto self = weak.lock();
      if (!stopped && self) self->beat();
    });
  }
  void rest() {
    is_moving = false;
    timer.cancel();
    if (guard) guard->standing();
  }

  asio::steady_timer timer;
  std::unique_ptr<StageGuard> guard;
  bool is_moving = false;
};

class StageDriver::Turn {
 public:
  explicit Turn(std::shared_ptr<Line> line) : line_(std::move(line)) { line_->taken = true; }
  Turn(Turn&& other) noexcept : line_(std::move(other.line_)) {}
  Turn& operator=(Turn&&) = delete;
  ~Turn() {
    if (line_ == nullptr) return;
    line_->taken = false;
    for (asio::steady_timer* timer : line_->waiting) timer->cancel();
  }

 private:
  std::shared_ptr<Line> line_;
};

/// A timer among those that wait for the line. It lies in a coroutine, which may be destroyed while it waits,
/// and after the driver, too.
class StageDriver::Place {
 public:
  Place(std::shared_ptr<Line> line, asio::steady_timer& timer) : line_(std::move(line)), timer_(&timer) {
    line_->waiting.push_back(timer_);
  }
  ~Place() { std::erase(line_->waiting, timer_); }
  Place(const Place&) = delete;
  Place& operator=(const Place&) = delete;

 private:
  std::shared_ptr<Line> line_;
  asio::steady_timer* timer_;
};

StageDriver::StageDriver(asio::any_io_executor executor, StageOptions options,
                         std::unique_ptr<SerialLink> link, std::unique_ptr<StageProtocol> protocol)
    : executor_(std::move(executor)),
      options_(std::move(options)),
      link_(std::move(link)),
      protocol_(std::move(protocol)),
      line_(std::make_shared<Line>()),
      heartbeat_(std::make_shared<Heartbeat>(executor_)) {}

/// Whoever forgets the stage must not leave it moving.
StageDriver::~StageDriver() {
  heartbeat_->timer.cancel();
  if (heartbeat_->is_moving) link_->write_now(protocol_->stop_for_good());
}

// --- the line ---

awaitable<StageDriver::Turn> StageDriver::take_turn(std::size_t stops) {
  const auto end = Clock::now() + duration(longest_turn_s);
  while (line_->taken) {
    if (Clock::now() > end)
      throw StageError("the stage's serial line stayed busy. Nothing was sent; try again.");
    asio::steady_timer timer(executor_, end);
    const Place place(line_, timer);
    boost::system::error_code woken;
    co_await timer.async_wait(asio::redirect_error(asio::use_awaitable, woken));
  }
  demand_not_stopped(stops);
  co_return Turn(line_);
}

awaitable<void> StageDriver::pause(double seconds) const {
  if (!(seconds > 0)) co_return;
  asio::steady_timer timer(executor_, duration(seconds));
  co_await timer.async_wait(asio::use_awaitable);
}

void StageDriver::demand_not_stopped(std::size_t stops) const {
  if (stops != stops_) throw StageError("the stage was stopped. Give the command again to continue.");
}

awaitable<StageReading> StageDriver::read(std::size_t stops) {
  const Turn turn = co_await take_turn(stops);
  co_return co_await protocol_->read();
}

awaitable<StageReading> StageDriver::read_twice(std::size_t stops) {
  StageReading before = co_await read(stops);
  for (int i = 0; i < most_reads; ++i) {
    StageReading again = co_await read(stops);
    if (again.position == before.position) co_return again;
    before = again;
  }
  throw StageError(
      "the stage reports that it is at rest, but its position keeps changing. The capture there was "
      "not "
      "begun. Look for vibration, a hunting servo, or a noisy cable.");
}

// --- angles and limits ---

long long StageDriver::to_units(double deg) const {
  return std::llround((deg * options_.direction + options_.zero_deg.value_or(0)) * identity_.units_per_deg);
}

double StageDriver::to_deg(double units) const {
  return (units / identity_.units_per_deg - options_.zero_deg.value_or(0)) * options_.direction;
}

void StageDriver::demand_within_limits(double deg) const {
  if (!std::isfinite(deg))
    throw StageError("the stage was commanded to go to an angle that is not a number. Nothing was moved.");
  if (deg >= options_.min_deg && deg <= options_.max_deg) return;
  throw StageError(
      "the stage was commanded to go to " + in_deg(deg) + ", beyond its soft limits " +
      in_deg(options_.min_deg) + " to " + in_deg(options_.max_deg) +
      ". Nothing was moved. Change the procedure, or limits_deg in the bench file if the cable allows it.");
}

awaitable<void> StageDriver::demand_homed(std::size_t stops) {
  if (!options_.needs_homing) co_return;
  const StageReading reading = co_await read(stops);
  if (!reading.homed)
    throw StageError(
        "the stage has not been homed since it was switched on, so its angles are meaningless. Nothing was "
        "moved. "
        "Home it first (step `home`), or set needs_homing: false in the bench file if any zero will do.");
}

// --- what every stage does ---

awaitable<void> StageDriver::start() {
  link_->discard();
  identity_ = co_await who();
  heartbeat_->guard = std::make_unique<StageGuard>(link_->descriptor(), protocol_->stop_for_good());
  const StageReading reading = co_await protocol_->read();
  // Somebody left it turning: a procedure must not begin on a moving stage.
  found_moving_ = reading.moving;
  if (reading.moving) co_await stop();
  const double speed = options_.speed_deg_s * identity_.units_per_deg;
  const double acceleration = options_.acceleration_deg_s2 * identity_.units_per_deg;
  if (speed > 0 || acceleration > 0) co_await protocol_->set_speed(speed, acceleration);
  speed_deg_s_ = options_.speed_deg_s;
}

awaitable<StageIdentity> StageDriver::who() { co_return printable(co_await protocol_->identify()); }

awaitable<StageIdentity> StageDriver::identify() {
  const Turn turn = co_await take_turn(stops_);
  identity_ = co_await who();
  co_return identity_;
}

awaitable<StageStatus> StageDriver::status() {
  const StageReading reading = co_await read(stops_);
  if (!reading.moving) heartbeat_->rest();
  StageStatus status;
  status.position_deg = to_deg(reading.position);
  status.moving = reading.moving;
  status.homed = reading.homed;
  status.warnings = reading.warnings;
  if (!reading.fault.empty()) status.warnings.insert(status.warnings.begin(), reading.fault);
  if (std::exchange(found_moving_, false))
    status.warnings.insert(status.warnings.begin(), "it was found moving and was stopped");
  co_return status;
}

awaitable<void> StageDriver::home() {
  const std::size_t stops = stops_;
  {
    const Turn turn = co_await take_turn(stops);
    heartbeat_->beat();
    co_await protocol_->start_homing();
  }
  const StageReading reading = co_await wait_for_rest("homing", options_.home_s, stops);
  if (!reading.homed)
    throw StageError(
        "the stage ended homing without finding its reference. It is not homed. Check that nothing blocks it "
        "and "
        "that its home sensor is connected, and home it again.");
}

awaitable<void> StageDriver::start_move(long long units, std::size_t stops) {
  const Turn turn = co_await take_turn(stops);
  heartbeat_->beat();
  co_await protocol_->start_move(units);
}

awaitable<double> StageDriver::move_to(double target_deg) {
  const std::size_t stops = stops_;
  demand_within_limits(target_deg);
  co_await demand_homed(stops);
  co_await use_speed(options_.speed_deg_s, stops);
  const long long target = to_units(target_deg);
  co_await start_move(target, stops);
  const std::string activity = "the move to " + in_deg(target_deg);
  // As long as it makes progress it may take its time: fixed limits kill good moves.
  StageReading reading = co_await wait_for_rest(activity, 3600, stops);
  if (options_.needs_homing && !reading.homed)
    throw StageError("the stage lost its reference during " + activity +
                     ": its power was interrupted. Its angles are meaningless now. Check its power supply, "
                     "home it and resume.");
  co_await pause(options_.settle_s);
  reading = co_await read_twice(stops);
  const double readback_deg = to_deg(reading.position);
  if (std::abs(readback_deg - target_deg) > options_.tolerance_deg)
    throw StageError(
        activity + " ended at " + in_deg(readback_deg) + ", off by more than the tolerance of " +
        in_deg(options_.tolerance_deg) +
        (reading.warnings.empty() ? "" : " (the stage warns: " + reading.warnings.front() + ")") +
        ". Nothing was measured there. Check that the stage turns freely and home it again.");
  co_return readback_deg;
}

awaitable<void> StageDriver::use_speed(double deg_s, std::size_t stops) {
  if (deg_s == speed_deg_s_) co_return;
  const Turn turn = co_await take_turn(stops);
  co_await protocol_->set_speed(deg_s * identity_.units_per_deg, 0);
  speed_deg_s_ = deg_s;
}

awaitable<void> StageDriver::turn(double rate_deg_s) {
  const std::size_t stops = stops_;
  if (!std::isfinite(rate_deg_s) || rate_deg_s == 0)
    throw StageError("the stage was commanded to turn at a rate of " + text_of(rate_deg_s) +
                     " deg/s. Nothing was moved.");
  if (!protocol_->has_speed())
    throw StageError(
        "the stage was commanded to turn at a given rate, but its language has no speed. Nothing was moved. "
        "Use a "
        "sweep "
        "of steps instead.");
  co_await demand_homed(stops);
  const double end_deg = rate_deg_s > 0 ? options_.max_deg : options_.min_deg;
  if (std::isfinite(end_deg)) {
    // As a move to the soft limit: the stage ends there by itself even if this computer is gone.
    co_await use_speed(std::abs(rate_deg_s), stops);
    co_await start_move(to_units(end_deg), stops);
    co_return;
  }
  const Turn turn = co_await take_turn(stops);
  heartbeat_->beat();
  co_await protocol_->start_turn(rate_deg_s * options_.direction * identity_.units_per_deg);
}

/// A port that has just been lost often comes back at once, and a stage that may still move is worth a few
/// attempts.
awaitable<void> StageDriver::stop() {
  std::exception_ptr lost;
  for (double wait_s = first_return_s; wait_s < longest_return_s; wait_s *= 2) {
    bool is_reopened = false;
    try {
      co_await stop_once();
      co_return;
    } catch (const StageLost&) {
      lost = std::current_exception();
    }
    co_await pause(wait_s);
    try {
      auto opening = reopen();  // Which stops it.
      co_await std::move(opening);
      is_reopened = true;
    } catch (const StageError&) {
    }
    if (is_reopened) co_return;
  }
  std::rethrow_exception(lost);
}

awaitable<void> StageDriver::stop_once() {
  const std::size_t stops = ++stops_;
  if (line_->taken) {
    link_->write_now(protocol_->stop_now());
    link_->forget_answers();
  }
  {
    const Turn turn = co_await take_turn(stops);
    co_await protocol_->start_stop();
  }
  try {
    co_await wait_for_rest(stopping, longest_stop_s, stops);
  } catch (const StageLost&) {
    throw;
  } catch (const StageError&) {
    if (stops == stops_) throw;  // Otherwise a later stop() has taken over.
  }
}

awaitable<StageReading> StageDriver::wait_for_rest(const std::string& activity, double longest_s,
                                                   std::size_t stops) {
  const auto end = Clock::now() + duration(longest_s);
  auto progressed = Clock::now();
  double poll_s = first_poll_s;
  StageReading before;
  for (bool is_first = true;; is_first = false) {
    // At least one poll after the acknowledgement: it may say "idle" before the motion has begun.
    StageReading reading = co_await read(stops);
    if (!reading.fault.empty() && (reading.moving || activity != stopping))
      throw StageError(activity + " failed: " + reading.fault + " (at " + in_deg(to_deg(reading.position)) +
                       "). The stage has stopped. Free it or switch it off and on, home it, and resume.");
    if (!reading.moving) {
      heartbeat_->rest();
      co_return reading;
    }
    if (is_first || reading.position != before.position) progressed = Clock::now();
    if (Clock::now() > progressed + duration(no_progress_s) || Clock::now() > end) {
      const std::string why =
          Clock::now() > end
              ? " takes longer than " + text_of(longest_s) + " s"
              : " does not progress: the stage reports that it moves, but its position does not change";
      throw StageError(activity + why + " (at " + in_deg(to_deg(reading.position)) +
                       "). Stop it, check that nothing blocks the stage, home it and resume.");
    }
    before = reading;
    co_await pause(poll_s);
    poll_s = std::min(1.5 * poll_s, longest_poll_s);
  }
}

awaitable<void> StageDriver::reopen() {
  const std::size_t stops = ++stops_;
  auto taking = take_turn(stops);
  {
    const Turn turn = co_await std::move(taking);
    heartbeat_->timer.cancel();
    heartbeat_->guard.reset();  // It holds the old port, and the lock on it.
    link_->reopen();
    protocol_->link_was_lost();
    const StageIdentity now = co_await who();
    if (now.serial != identity_.serial || now.model != identity_.model)
      throw StageError("another stage answers on " + link_->path() + " (" + now.model + " " + now.serial +
                       " instead of " + identity_.model + " " + identity_.serial +
                       "). It was not moved. Plug the right one in, or begin a new session.");
    heartbeat_->guard = std::make_unique<StageGuard>(link_->descriptor(), protocol_->stop_for_good());
    speed_deg_s_ = 0;
    const double speed = options_.speed_deg_s * identity_.units_per_deg;
    const double acceleration = options_.acceleration_deg_s2 * identity_.units_per_deg;
    if (speed > 0 || acceleration > 0) {
      co_await protocol_->set_speed(speed, acceleration);
      speed_deg_s_ = options_.speed_deg_s;
    }
  }
  const StageReading reading = co_await read(stops);
  if (reading.moving) co_await stop_once();
}

}  // namespace rig
