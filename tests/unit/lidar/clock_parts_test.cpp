// SPDX-License-Identifier: MIT
// What the clock estimator is made of, each by itself: timer, round of exchanges, least lateness.
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "lidar/device_timer.hpp"
#include "lidar/exchange_round.hpp"
#include "lidar/least_lateness.hpp"

namespace clock_parts_test {

using lidar::DeviceTimer;

TEST_CASE("a timer's wrap is undone, and an answer that comes late is not taken for one") {
  DeviceTimer timer;
  const std::uint32_t last = 0xFFFFFF;
  CHECK(timer.unwrap(last - 5, 0, true).ms == last - 5);
  const auto wrapped = timer.unwrap(4, 10'000, true);
  CHECK(wrapped.ms == last + 5ULL);
  CHECK_FALSE(wrapped.started_again);
  CHECK(timer.unwrap(2, 11'000, true).ms == last + 3ULL);  // Two milliseconds back.
  CHECK(timer.unwrap(14, 20'000, true).ms == last + 15ULL);
  CHECK(timer.resets() == 0);
}

TEST_CASE("a timer that starts again goes on by the host's clock, on a base of its own") {
  DeviceTimer timer;
  timer.unwrap(5'000'000, 0, true);
  const auto reading = timer.unwrap(100, 3e6, true);
  CHECK(reading.started_again);
  CHECK(reading.ms == 5'003'000);
  CHECK(timer.since_start_ms(reading.ms) == 100);
  CHECK(timer.resets() == 1);
  CHECK(timer.unwrap(125, 3.025e6, true).ms == 5'003'025);
}

TEST_CASE("a timer that stands still has not started again, until it moves from where it stood") {
  DeviceTimer timer;
  timer.unwrap(50'000, 0, true);
  for (const double host_us : {8e6, 9e6}) {
    timer.begin_connection();
    const auto still = timer.unwrap(50'000, host_us, true);
    CHECK_FALSE(still.started_again);
    CHECK(still.ms == 50'000);
  }
  CHECK(timer.resets() == 0);
  CHECK(timer.unwrap(50'025, 20e6, true).started_again);
}

TEST_CASE("hours of silence hide whole turns of the timer") {
  DeviceTimer timer;
  timer.unwrap(1000, 0, true);
  const std::uint64_t passed_ms = 3 * 0x1000000ULL + 70'000;
  const auto stamp = static_cast<std::uint32_t>((1000 + passed_ms) & 0xFFFFFF);
  const auto reading = timer.unwrap(stamp, 1e3 * static_cast<double>(passed_ms), true);
  CHECK(reading.ms == 1000 + passed_ms);
  CHECK_FALSE(reading.started_again);
}

TEST_CASE("exchanges bound the timer from both sides, and the newest win where they contradict each other") {
  lidar::ExchangeRound round;
  // The timer's millisecond k begins at host time 1000 k + 300; each way takes 200 us.
  const auto asked_at = [&](double sent_us) {
    round.add({std::floor((sent_us + 200 - 300) / 1000), sent_us, sent_us + 400});
  };
  for (int i = 0; i < 12; ++i) asked_at(2000.0 * i + 83.0 * i);
  CHECK(round.shortest_round_trip_us() == Approx(400));
  CHECK(round.answering().step_ms == 1);
  const auto bounds = round.bounds(10, round.answering(), {0, 0});
  CHECK(bounds.low_us <= 10'300);
  CHECK(bounds.high_us >= 10'300);
  CHECK(bounds.high_us - bounds.low_us < 700);
  CHECK(bounds.used == 12);

  round.add({40, 90'000, 90'400});  // The timer stands 50 ms elsewhere now.
  CHECK(round.bounds(40, {}, {0, 0}).used == 1);
}

TEST_CASE("the least lateness is found below exponential delays, within its uncertainty") {
  std::mt19937 random(5);
  std::exponential_distribution<double> delay(1 / 150.0);
  int within = 0;
  for (int repeat = 0; repeat < 200; ++repeat) {
    std::vector<lidar::Lateness> scans;
    for (int i = 0; i < 80; ++i) scans.push_back({700 + delay(random), 25.0 * i, 0});
    const lidar::LeastLateness least = lidar::least_of(scans);
    CHECK(least.u_us >= lidar::least_u_lateness_us);
    CHECK(least.u_us < 150);  // The delays themselves scatter by so much.
    within += std::abs(least.us - 700) < 2 * least.u_us;
  }
  CHECK(within >= 170);
}

}  // namespace clock_parts_test
