// SPDX-License-Identifier: MIT
// The clock estimate against the simulated device's truth, in simulated time: no sockets, no waiting.
#include <catch2/catch.hpp>
#include <random>

#include "lidar/clock_estimator.hpp"
#include "lidar/frame_reader.hpp"
#include "lidar/reply.hpp"
#include "tests/support/lidar_bench.hpp"

namespace lidar_clock_test {
namespace {

std::uint32_t time_in(const std::string& reply) {
  lidar::FrameReader reader;
  reader.feed(reply);
  const auto frame = reader.next();
  return static_cast<std::uint32_t>(*lidar::decode_time((**frame).body));
}

std::uint32_t stamp_in(const std::string& scan, const lidar::ScanCommand& command) {
  lidar::FrameReader reader;
  reader.feed(scan);
  const auto frame = reader.next();
  return static_cast<std::uint32_t>(lidar::decode_scan((**frame).body, command)->stamp);
}

/// RMS error of the scans' host times, us, for one network's random delays; with `slow_frame` of a firmware
/// that answers and sends every 5 ms only, without the first 20 s.
double error_us(unsigned seed, std::uint32_t clock_start_ms, bool slow_frame = false) {
  std::mt19937 random(seed);
  std::exponential_distribution<> delay_us(1 / 150.0);
  sim::UstIdentity identity;
  identity.scan_period_s = 0.02503;
  identity.clock_start_ms = clock_start_ms;
  sim::UstDevice device = lidar_bench::device(identity);
  device.set_habit(sim::UstHabit::slow_frame, slow_frame);
  lidar::ClockEstimator clock(25, 18.75);

  double now_us = 5e6;
  (void)device.handle("TM0", now_us * 1e-6);
  clock.begin_exchanges();
  for (int i = 0; i < 150; ++i) {
    const double sent = clock.best_time_to_send(now_us + 150);
    const double arrived = sent + 40 + delay_us(random);
    const double read = 1e6 * device.answers_at_s("TM1;r1", arrived * 1e-6),
                 received = read + 40 + delay_us(random);
    const std::uint32_t stamp = time_in(device.handle("TM1;r1", read * 1e-6));
    clock.add_exchange(sent, received, clock.unwrap(stamp, received));
    now_us = received;
  }
  clock.end_exchanges();
  (void)device.handle("TM2", now_us * 1e-6);

  (void)device.handle("MD0540054001000", now_us * 1e-6);
  clock.begin_stream();
  lidar::ScanCommand command;
  command.format = lidar::ScanFormat::distance3;
  command.first_step = command.last_step = 540;
  constexpr int scans = 4000;
  const int first = slow_frame ? 800 : 0;
  double squares = 0;
  std::string scan;
  for (int i = 0; i < scans; ++i) {
    const double ready_s = device.next_scan_ready_s(now_us * 1e-6);
    scan.clear();
    device.append_next_scan(scan);
    now_us = ready_s * 1e6;
    const double arrival = now_us + 580 + delay_us(random);
    const double host = clock.add_scan(clock.unwrap(stamp_in(scan, command), arrival), arrival);
    const double truth = (device.scan_end_s() - identity.scan_period_s) * 1e6;
    if (i >= first) squares += (host - truth) * (host - truth);
  }
  return std::sqrt(squares / (scans - first));
}

}  // namespace

TEST_CASE("host times of scans agree with the simulated device's truth to 40 us") {
  double squares = 0;
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const double one = error_us(seed, seed == 5 ? 0x1000000 - 30000 : 0);  // the last passes the timer's wrap
    INFO("seed " << seed << ": " << one << " us");
    CHECK(one < 80);
    squares += one * one / 5;
  }
  CHECK(std::sqrt(squares) < 40);
}

TEST_CASE("host times of a lidar that answers and sends on a 5 ms frame agree with the truth to 100 us") {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    const double one = error_us(seed, 0, true);
    INFO("seed " << seed << ": " << one << " us");
    CHECK(one < 100);
  }
}

}  // namespace lidar_clock_test
