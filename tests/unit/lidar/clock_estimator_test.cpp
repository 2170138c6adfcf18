// SPDX-License-Identifier: MIT
#include "lidar/clock_estimator.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <random>

using lidar::ClockEstimator;

namespace {

/// A lidar whose timer runs a little fast or slow, whose motor turns evenly but at a speed of its own, and a
/// network that delays at random. All times on the host's clock, microseconds.
struct Scenario {
  double period_ms = 25.05;    ///< True time of one turn.
  double drift_ppm = 50;       ///< How fast the timer is.
  double drift_swing_ppm = 0;  ///< And how much that swings, over two minutes.
  double wander_us = 0;        ///< Each turn's random error.
  double delay_us = 150;       ///< Mean random delay each way, on top of the least.
  double least_up_us = 40, least_down_us = 40;
  double hiccup_probability = 0.01, hiccup_us = 5000;
  bool on_frames = true;  ///< Scans leave on the timer's next millisecond.
  int scans = 2400;
  int exchanges = 40;
  bool synchronise = true;
};

struct Outcome {
  double rms_us = 0, worst_us = 0, mean_us = 0;
  double covered = 0;  ///< Share of scans within two stated standard uncertainties.
  double stated_us = 0;
  lidar::ClockEstimate estimate;
};

class World {
 public:
  World(const Scenario& scenario, unsigned seed) : s_(scenario), random_(seed) {
    start_us_ = uniform(1e6, 1e9);
    timer_ms_ = uniform(0, 1e6);
  }

  double timer_ms(double host_us) const {
    const double t = (host_us - start_us_) / 1000, turn_ms = 120e3 / (2 * M_PI);
    return timer_ms_ + t * (1 + s_.drift_ppm * 1e-6) +
           s_.drift_swing_ppm * 1e-6 * turn_ms * (1 - std::cos(t / turn_ms));
  }
  std::uint32_t stamp(double host_us) const {
    return static_cast<std::uint32_t>(static_cast<std::uint64_t>(std::floor(timer_ms(host_us))) & 0xFFFFFF);
  }
  double delay(double least) {
    double d = least + std::exponential_distribution<>(1 / s_.delay_us)(random_);
    if (uniform(0, 1) < s_.hiccup_probability) d += s_.hiccup_us * uniform(0, 1);
    return d;
  }
  double uniform(double a, double b) { return std::uniform_real_distribution<>(a, b)(random_); }

  Outcome run() {
    ClockEstimator clock(25, 18.75);
    double now = start_us_;
    if (s_.synchronise) now = exchange(clock, now);
    clock.begin_stream();
    Outcome out;
    double begin = now + uniform(0, 25000), last_arrival = 0, squares = 0;
    for (int i = 0; i < s_.scans; ++i) {
      const double true_start = begin + s_.wander_us * std::normal_distribution<>()(random_);
      begin += 1000 * s_.period_ms;
      double leaves = true_start + 750 * s_.period_ms;
      if (s_.on_frames) leaves += 1000 * (std::ceil(timer_ms(leaves)) - timer_ms(leaves));
      last_arrival = std::max(last_arrival, leaves + delay(s_.least_down_us + 540));
      const double host = clock.add_scan(clock.unwrap(stamp(true_start), last_arrival), last_arrival);
      const double error = host - true_start;
      squares += error * error;
      out.mean_us += error / s_.scans;
      out.worst_us = std::max(out.worst_us, std::abs(error));
      out.covered += std::abs(error) <= 2 * clock.u_scan_us() ? 1.0 / s_.scans : 0;
      out.stated_us += clock.u_scan_us() / s_.scans;
    }
    out.rms_us = std::sqrt(squares / s_.scans);
    out.estimate = clock.estimate();
    return out;
  }

 private:
  double exchange(ClockEstimator& clock, double now) {
    clock.begin_exchanges();
    for (int i = 0; i < s_.exchanges; ++i) {
      const double wanted = i < 10 ? now + uniform(0, 2000) : clock.best_time_to_send(now + 150);
      const double sent = wanted + uniform(-30, 60);
      const double read = sent + delay(s_.least_up_us), received = read + delay(s_.least_down_us);
      clock.add_exchange(sent, received, clock.unwrap(stamp(read), received));
      now = received;
    }
    clock.end_exchanges();
    return now;
  }

  Scenario s_;
  std::mt19937 random_;
  double start_us_, timer_ms_;
};

struct Summary {
  double rms_us = 0, worst_rms_us = 0, covered = 0, stated_us = 0;
};

Summary over_seeds(const Scenario& base, unsigned seeds) {
  Summary all;
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    std::mt19937 random(seed * 7919);
    Scenario s = base;
    // Motors are off by up to 0.2 %, crystals by up to 100 ppm (scip.md).
    s.period_ms = std::uniform_real_distribution<>(24.95, 25.05)(random);
    s.drift_ppm = std::uniform_real_distribution<>(-100, 100)(random);
    World world(s, seed);
    const Outcome one = world.run();
    all.rms_us += one.rms_us * one.rms_us / seeds;
    all.worst_rms_us = std::max(all.worst_rms_us, one.rms_us);
    all.covered += one.covered / seeds;
    all.stated_us += one.stated_us / seeds;
    UNSCOPED_INFO("seed " << seed << ": rms " << one.rms_us << " us, mean " << one.mean_us << ", worst "
                          << one.worst_us << ", covered " << one.covered << ", stated " << one.stated_us
                          << ", period " << s.period_ms << ", drift " << s.drift_ppm << " found "
                          << one.estimate.drift_ppm << " +- " << one.estimate.drift_u_ppm);
  }
  all.rms_us = std::sqrt(all.rms_us);
  UNSCOPED_INFO("all: rms " << all.rms_us << " covered " << all.covered << " stated " << all.stated_us);
  return all;
}

}  // namespace

TEST_CASE("scan times are right to 40 us RMS from millisecond stamps, with delays and drift") {
  const Summary all = over_seeds(Scenario(), 20);
  CHECK(all.rms_us < 40);
  CHECK(all.covered > 0.9);
}

TEST_CASE("explore", "[.explore]") {
  Scenario s;
  SECTION("default") { over_seeds(s, 20); }
  SECTION("swing") {
    s.drift_swing_ppm = 5;
    over_seeds(s, 20);
  }
  SECTION("wander") {
    s.wander_us = 5;
    over_seeds(s, 20);
  }
  SECTION("wander big") {
    s.wander_us = 30;
    over_seeds(s, 20);
  }
  SECTION("no frames") {
    s.on_frames = false;
    over_seeds(s, 20);
  }
  SECTION("unsynchronised") {
    s.synchronise = false;
    over_seeds(s, 20);
  }
  SECTION("short") {
    s.scans = 200;
    over_seeds(s, 20);
  }
  SECTION("slow network") {
    s.delay_us = 1000;
    over_seeds(s, 20);
  }
  CHECK(false);
}
