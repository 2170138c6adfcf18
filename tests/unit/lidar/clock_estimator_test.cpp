// SPDX-License-Identifier: MIT
#include "lidar/clock_estimator.hpp"

#include <catch2/catch.hpp>
#include <cmath>

#include "tests/support/clock_world.hpp"

namespace clock_estimator_test {

using clock_world::Outcome;
using clock_world::Scenario;
using clock_world::Summary;
using clock_world::World;
using lidar::ClockEstimator;

namespace {

Summary over_seeds(const Scenario& base, unsigned seeds) {
  const Summary all =
      clock_world::over_seeds(base, seeds, [](unsigned seed, const Scenario& s, const Outcome& one) {
        UNSCOPED_INFO("seed " << seed << ": rms " << one.rms_us << " us, converged " << one.converged_rms_us
                              << ", mean " << one.mean_us << ", worst " << one.worst_us << ", covered "
                              << one.covered << ", stated " << one.stated_us << ", period " << s.period_ms
                              << ", drift " << s.drift_ppm << " found " << one.estimate.drift_ppm << " +- "
                              << one.estimate.drift_u_ppm);
      });
  UNSCOPED_INFO("all: rms " << all.rms_us << " converged " << all.converged_rms_us << " worst "
                            << all.worst_rms_us << " covered " << all.covered << " stated " << all.stated_us);
  return all;
}

}  // namespace

TEST_CASE("scan times are right to 40 us RMS from millisecond stamps, with delays and drift") {
  const Summary all = over_seeds(Scenario(), 40);
  CHECK(all.rms_us < 40);
  CHECK(all.covered > 0.95);
  CHECK(all.in_order);
}

TEST_CASE(
    "scan times are right to 100 us RMS once 20 s are seen from a lidar that answers and sends on a 5 ms "
    "frame") {
  Scenario s;
  s.frame_ms = 5;
  s.scans = 4000;
  const Summary all = over_seeds(s, 20);
  CHECK(all.late_rms_us < 100);
  CHECK(all.covered > 0.93);
  CHECK(all.in_order);
  const Outcome one = World(s, 3).run();
  INFO("drift " << one.estimate.drift_ppm << " +- " << one.estimate.drift_u_ppm);
  CHECK(std::abs(one.estimate.drift_ppm - s.drift_ppm) < 3 * one.estimate.drift_u_ppm);
}

TEST_CASE("two standard uncertainties of scan times cover 93 to 98 % whatever each way takes, up to 1 ms") {
  double covered = 0;
  int cases = 0;
  for (const double frame_ms : {1.0, 5.0})
    for (const double jitter_us : {20.0, 150.0, 400.0})
      for (const double busy_share : {0.0, 0.3}) {
        Scenario s;
        s.frame_ms = frame_ms;
        s.delay_us = jitter_us;
        s.busy_share = busy_share;
        s.most_way_us = 1000;
        s.scans = 1600;
        const Summary all = over_seeds(s, 60);
        INFO("frame " << frame_ms << " ms, jitter " << jitter_us << " us, busy " << busy_share);
        CHECK(all.covered > 0.9);
        CHECK(all.in_order);
        covered += all.covered;
        ++cases;
      }
  INFO("covered in the mean of all cases: " << covered / cases);
  CHECK(covered / cases > 0.93);
  CHECK(covered / cases < 0.98);
}

TEST_CASE("a timer that counts in steps of 5 ms is seen to do so") {
  Scenario s;
  s.frame_ms = 5;
  s.stamps_in_frames = true;
  s.scans = 2000;
  const Summary all = over_seeds(s, 20);
  CHECK(all.rms_us < 1000);
  CHECK(all.covered > 0.93);
}

TEST_CASE("scan times bear a drift that swings with the temperature and a motor that wanders") {
  Scenario s;
  SECTION("drift") {
    s.drift_swing_ppm = 2;
    const Summary all = over_seeds(s, 20);
    CHECK(all.rms_us < 60);
    CHECK(all.covered > 0.9);
  }
  SECTION("motor, a little") {
    s.wander_us = 5;
    const Summary all = over_seeds(s, 20);
    CHECK(all.rms_us < 60);
    CHECK(all.covered > 0.9);
  }
  SECTION("motor, much") {
    s.wander_us = 10;
    const Summary all = over_seeds(s, 20);
    CHECK(all.rms_us < 150);
    CHECK(all.covered > 0.9);
  }
}

TEST_CASE("scan times state their uncertainty where less is known") {
  Scenario s;
  s.scans = 4000;
  SECTION("a lidar that does not send on its timer's ticks") {
    s.on_tick = false;
    const Summary all = over_seeds(s, 20);
    CHECK(all.rms_us < 300);
    CHECK(all.covered > 0.9);
  }
  SECTION("a network with delays of 0.4 ms") {
    s.delay_us = 400;
    const Summary all = over_seeds(s, 20);
    CHECK(all.rms_us < 100);
    CHECK(all.covered > 0.9);
  }
  SECTION("a network with delays of 1 ms: ticks are told apart less surely, but never lost") {
    s.delay_us = 1000;
    const Summary all = over_seeds(s, 20);
    CHECK(all.rms_us < 500);
    CHECK(all.worst_rms_us < 2000);
  }
  SECTION("a host that is busy for a third of the time") {
    s.busy_share = 0.3;
    const Summary all = over_seeds(s, 20);
    CHECK(all.rms_us < 150);
    CHECK(all.covered > 0.93);
  }
  SECTION("a timer that starts again and is not synchronised anew") {
    s.reboot_at = 2000;
    const Summary all = over_seeds(s, 20);
    CHECK(all.rms_us < 500);
    CHECK(all.covered > 0.9);
  }
  SECTION("clocks never synchronised") {
    s.synchronise = false;
    const Summary all = over_seeds(s, 20);
    CHECK(all.rms_us < 1000);
    CHECK(all.covered > 0.9);
  }
}

TEST_CASE("the timer's 24-bit wrap passes unseen") {
  Scenario s;
  s.scans = 2000;
  s.timer_ms = 0x1000000 - 20000;  // 20 s before it
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const Outcome one = World(s, seed).run();
    INFO("seed " << seed << " rms " << one.rms_us << " worst " << one.worst_us);
    CHECK(one.in_order);
    CHECK(one.estimate.resets == 0);
    CHECK(one.converged_rms_us < 80);
  }
}

TEST_CASE("a timer that starts again in the middle of a stream is counted, and time goes on") {
  Scenario s;
  s.scans = 4000;
  s.reboot_at = 2000;
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const Outcome one = World(s, seed).run();
    INFO("seed " << seed << " rms " << one.rms_us << " worst " << one.worst_us);
    CHECK(one.in_order);
    CHECK(one.estimate.resets == 1);
    CHECK_FALSE(one.estimate.synchronised);  // until TM is exchanged anew
    CHECK(one.worst_us < 2000);
  }
}

TEST_CASE("stamps are unwrapped through turns, late answers and hours of silence") {
  ClockEstimator clock;
  CHECK(clock.unwrap(0xFFFFF0, 0) == 0xFFFFF0);
  CHECK(clock.unwrap(0x000010, 32e3) == 0x1000010);
  CHECK(clock.unwrap(0x000008, 33e3) == 0x1000008);  // an answer that was overtaken
  CHECK(clock.unwrap(0x000020, 48e3) == 0x1000020);
  const double turns_us = 3 * 16777216e3;
  CHECK(clock.unwrap(0x000020, 48e3 + turns_us) == 0x4000020);
  CHECK(clock.estimate().resets == 0);
}

TEST_CASE("a timer that starts again before it has counted a second is no late answer from before zero") {
  ClockEstimator clock;
  CHECK(clock.unwrap(700, 0) == 700);
  const std::uint64_t later = clock.unwrap(0xFFFFFF - 199, 100e3);
  CHECK(later > 700);
  CHECK(later < std::uint64_t{1} << 25);
  CHECK(clock.unwrap(50, 350e3) == later + 250);
}

TEST_CASE("a timer that starts again begins a time base that goes on by the host's clock") {
  const auto after_reboot = [](std::uint32_t before_ms, std::uint32_t after_ms, double passed_us) {
    ClockEstimator clock;
    const std::uint64_t before = clock.unwrap(before_ms, 0);
    clock.unwrap(before_ms + 1000, 1e6);
    clock.begin_connection();
    const std::uint64_t after = clock.unwrap(after_ms, 1e6 + passed_us);
    CHECK(clock.estimate().resets == 1);
    CHECK(clock.unwrap(after_ms + 25, 1e6 + passed_us + 25e3) == after + 25);
    return static_cast<double>(after - before) - 1000;
  };
  CHECK(after_reboot(100'000, 3'000, 4e6) == Approx(4000));     // behind the old timer
  CHECK(after_reboot(14'000'000, 3'000, 4e6) == Approx(4000));  // ahead of it, through the wrap
  CHECK(after_reboot(3'000, 3'600, 4e6) == Approx(4000));       // a moment behind it
  CHECK(after_reboot(9'000'000, 3'000, 120e6) == Approx(120e3));
}

TEST_CASE("a lidar that is connected anew and ran on has not started again") {
  ClockEstimator clock;
  CHECK(clock.unwrap(5000, 0) == 5000);
  clock.begin_connection();
  CHECK(clock.unwrap(605'060, 600e6) == 605'060);  // 100 ppm fast
  CHECK(clock.estimate().resets == 0);
}

TEST_CASE("a timer that jumps by hours within a stream begins a new time base; a stall of seconds does not") {
  ClockEstimator clock;
  for (std::uint32_t i = 0; i < 40; ++i)
    clock.add_scan(clock.unwrap(25 * i, 25e3 * i + 20e3), 25e3 * i + 20e3);
  CHECK(clock.unwrap(6000, 1020e3) == 6000);  // what came late before
  CHECK(clock.estimate().resets == 0);
  CHECK(clock.unwrap(8'000'000, 1045e3) == 6025);
  CHECK(clock.estimate().resets == 1);
}

TEST_CASE("the clock of a simulator at full speed is followed as it is") {
  ClockEstimator clock;
  double before = 0;
  for (int i = 0; i < 2000; ++i) {
    const double host = clock.add_scan(clock.unwrap(static_cast<std::uint32_t>(25 * i), 20.0 * i), 20.0 * i);
    if (i > 200) CHECK(host - before == Approx(25000).margin(1000));
    before = host;
  }
  CHECK_FALSE(clock.estimate().follows_host);
}

TEST_CASE("a host that does not read for seconds is not taken for a lidar with another clock") {
  Scenario s;
  s.scans = 4000;
  for (const int stalls_at : {0, 2000}) {
    s.stalls_at = stalls_at;
    const Outcome one = World(s, 3).run();
    INFO("stalls at " << stalls_at << ": rms " << one.rms_us << " worst " << one.worst_us);
    CHECK(one.estimate.follows_host);
    CHECK(one.in_order);
    CHECK(one.rms_us < 100);
  }
}

}  // namespace clock_estimator_test
