// SPDX-License-Identifier: MIT
#include "rig/runner/session_clock.hpp"

#include <catch2/catch.hpp>

#include "rig/runner/runner.hpp"

namespace session_clock_test {
namespace {

struct Clock final : rig::RunClock {
  std::int64_t now_us = 7'000'000;
  std::int64_t host_us() const override { return now_us; }
  std::int64_t unix_us() const override { return 1'000'000'000'000 + now_us; }
  boost::asio::awaitable<void> sleep(double) override { co_return; }
};

lidar::Scan scan_at(std::uint64_t device_ms, std::int64_t host_us) {
  lidar::Scan scan;
  scan.device_ms = device_ms;
  scan.host_us = host_us;
  return scan;
}

}  // namespace

TEST_CASE("a session's time runs with this computer's clock, and goes on where an earlier run left it") {
  Clock clock;
  rig::SessionClock time(clock);
  CHECK(time.now_us() == 0);
  CHECK(time.begun_unix_us() == 1'000'007'000'000);
  clock.now_us += 500;
  CHECK(time.now_us() == 500);
  CHECK(time.place_us(scan_at(3, 7'000'400)) == 400);

  time.go_on_from(1'000'000'000'000);
  CHECK(time.now_us() == 7'000'500);
  time.go_on_from(2'000'000'000'000);  // The computer's date was set back meanwhile.
  CHECK(time.now_us() == 500);
}

TEST_CASE("where the lidar's clock has nothing in common with the computer's, time is the lidar's") {
  Clock clock;
  rig::SessionClock time(clock);
  clock.now_us += 1000;
  time.follow_lidar(true);
  CHECK(time.now_us() == 1000);
  CHECK(time.place_us(scan_at(50'000, 0)) == 1000);
  clock.now_us += 5;
  CHECK(time.place_us(scan_at(50'025, 0)) == 26'000);
  CHECK(time.now_us() == 26'000);
  time.lidar_began_anew();
  CHECK(time.place_us(scan_at(3, 0)) == 26'000);
  CHECK(time.place_us(scan_at(28, 0)) == 51'000);
}

}  // namespace session_clock_test
