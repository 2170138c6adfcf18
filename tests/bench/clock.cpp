// SPDX-License-Identifier: MIT
// The host time of a scan from millisecond stamps: its error over 40 simulated lidars, each with drift, a
// motor of its own speed and random delays, one capture of 10,000 scans each. And what a scan's time costs.
#include <benchmark/benchmark.h>

#include "tests/support/clock_world.hpp"

namespace {

void error_of_host_time(benchmark::State& state) {
  clock_world::Summary all;
  for (auto _ : state)
    all = clock_world::over_seeds(clock_world::Scenario(), 40,
                                  [](unsigned, const clock_world::Scenario&, const clock_world::Outcome&) {});
  state.counters["rms_us"] = all.rms_us;
  state.counters["converged_rms_us"] = all.converged_rms_us;
  state.counters["worst_rms_us"] = all.worst_rms_us;
  state.counters["covered"] = all.covered;
  state.counters["rms_us at most"] = 40;  // the best public one: 89
}

void time_of_a_scan(benchmark::State& state) {
  lidar::ClockEstimator clock(25, 18.75);
  std::int64_t i = 0;
  for (auto _ : state) {
    ++i;
    const double at_us = 25050.0 * static_cast<double>(i);
    const auto stamp = static_cast<std::uint32_t>(25050 * i / 1000) & 0xFFFFFF;
    benchmark::DoNotOptimize(clock.add_scan(clock.unwrap(stamp, at_us), at_us));
  }
  state.SetItemsProcessed(state.iterations());
}

}  // namespace

BENCHMARK(error_of_host_time)
    ->Name("host time of a scan, error")
    ->Unit(benchmark::kMillisecond)
    ->Iterations(1);
BENCHMARK(time_of_a_scan)->Name("host time of a scan, cost");
BENCHMARK_MAIN();
