// SPDX-License-Identifier: MIT
// The mirror and the timer of a simulated lidar are held to one crystal.
#include "sim/ust_clock.hpp"

#include <catch2/catch.hpp>
#include <cmath>

#include "lidar/frame_reader.hpp"
#include "lidar/reply.hpp"
#include "tests/support/lidar_bench.hpp"

namespace ust_clock_test {
namespace {

constexpr double turn_s = 0.025;

/// A stream of single beams of a simulated lidar: what its stamps and true times are, scan by scan.
struct Streamed {
  explicit Streamed(const sim::UstIdentity& identity) : device(lidar_bench::device(identity)) {
    command.format = lidar::ScanFormat::distance3;
    command.first_step = command.last_step = 540;
  }
  void start(double now_s) { (void)device.handle("MD0540054001000", now_s); }
  /// The stamp of the next scan, ms.
  std::uint32_t next() {
    ready_s = device.next_scan_ready_s(ready_s);
    std::string bytes;
    device.append_next_scan(bytes);
    lidar::FrameReader reader;
    reader.feed(bytes);
    const auto frame = reader.next();
    return static_cast<std::uint32_t>(lidar::decode_scan((**frame).body, command)->stamp);
  }
  sim::UstDevice device;
  lidar::ScanCommand command;
  double ready_s = 0;
};

}  // namespace

TEST_CASE("a clock that drifts takes the mirror with it: stamps stay as far apart as they were") {
  for (const double ppm : {-400.0, 300.0, 5000.0}) {
    INFO(ppm);
    sim::UstIdentity identity;
    identity.clock_ppm = 20;  // so that no scan begins just where a millisecond does
    Streamed stream(identity);
    stream.start(1);
    std::uint32_t last_ms = 0;
    for (int i = 0; i < 10; ++i) last_ms = stream.next();
    const std::uint32_t first_ms = last_ms;
    const double drifts_from_s = stream.device.scan_end_s();
    stream.device.clock().set_ppm(drifts_from_s, ppm);
    for (int i = 0; i < 4000; ++i) {
      const std::uint32_t stamp_ms = stream.next();
      REQUIRE((stamp_ms - last_ms == 25 || stamp_ms - last_ms == 26));
      last_ms = stamp_ms;
    }
    CHECK(last_ms - first_ms == Approx(4000 * 25 * (1 + 20e-6)).margin(1));
    // On the bench's clock the same scans lie closer together, by as much as the crystal is fast.
    const double passed_s = stream.device.scan_end_s() - drifts_from_s;
    CHECK(passed_s == Approx(4000 * turn_s * (1 + 20e-6) / (1 + ppm * 1e-6)).epsilon(1e-9));
  }
}

TEST_CASE("a reboot starts timer and mirror together: the first turn is stamped 0, and turns follow on") {
  sim::UstIdentity identity;
  identity.clock_ppm = 50;
  Streamed stream(identity);
  stream.start(1);
  for (int i = 0; i < 7; ++i) (void)stream.next();
  const double rebooted_s = 12.3456789;  // in the middle of a turn of before
  stream.device.reboot(rebooted_s);
  CHECK_FALSE(stream.device.streaming());
  stream.ready_s = rebooted_s;
  stream.start(rebooted_s);
  for (int i = 1; i < 200; ++i) {
    REQUIRE(stream.next() == static_cast<std::uint32_t>(25 * i));
    REQUIRE(stream.device.scan_end_s() == Approx(rebooted_s + (i + 1) * turn_s).epsilon(1e-12));
  }
}

TEST_CASE("RS sets the timer to zero and leaves the mirror as it turns") {
  sim::UstClock clock(0, turn_s, 5000);
  const double before_s = clock.turn_begins_s(100);
  CHECK(clock.stamp_ms(2.5) == 7500);
  clock.zero_timer(2.51);
  CHECK(clock.turn_begins_s(100) == Approx(before_s).margin(1e-12));
  CHECK(clock.stamp_ms(3.5105) == 1000);
}

TEST_CASE("a timer that stands shows the same and goes on from there, while the mirror turns") {
  sim::UstClock clock(0, turn_s, 0);
  clock.stand(1.0005, 0.5);
  CHECK(clock.stamp_ms(0.9005) == 900);
  CHECK(clock.stamp_ms(1.2) == 1000);
  CHECK(clock.stamp_ms(1.5) == 1000);
  CHECK(clock.stamp_ms(2.5006) == 2000);
  CHECK(clock.turn_at(1.2501) == 50);
  clock.stand(3.0005, 0.25);
  CHECK(clock.stamp_ms(4.0006) == 3250);
}

TEST_CASE("turns are found from times, and times from turns, also while the clock drifts") {
  sim::UstClock clock(50, turn_s, 0);
  clock.set_ppm(10, 250);
  for (const std::int64_t turn : {401, 1000, 123456}) {
    const double begins_s = clock.turn_begins_s(turn);
    CHECK(clock.turn_at(begins_s + 1e-6) == turn);
    CHECK(clock.turn_from(begins_s - 1e-6) == turn);
    CHECK(clock.turn_from(begins_s + 1e-6) == turn + 1);
  }
}

}  // namespace ust_clock_test
