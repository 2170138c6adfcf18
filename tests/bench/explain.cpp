// SPDX-License-Identifier: MIT
// Explaining sessions of growing size: a 50,000-cell session in under 20 s on two cores, cost linear in
// cells.
#include <benchmark/benchmark.h>

#include "../support/imagined_room.hpp"
#include "fit/explain/explanation.hpp"

namespace {

void explain_room(benchmark::State& state) {
  ImaginedRoom room;
  room.every_beam = 1;
  room.captures = static_cast<int>(state.range(0) / 1081);
  room.bend = [](double beam) { return 0.001 * std::sin(beam + 1); };
  const SyntheticRecording recording = room.record();
  for (auto _ : state) {
    const auto explanation = fit::explain::explain({&recording}, {});
    benchmark::DoNotOptimize(explanation.cells);
  }
  state.counters["cells"] = static_cast<double>(state.range(0));
  state.counters["goal"] = 20;
}

}  // namespace

BENCHMARK(explain_room)
    ->Name("explain a session/ours")
    ->Arg(12972)
    ->Arg(25944)
    ->Arg(51888)
    ->Iterations(1)
    ->UseRealTime()
    ->Unit(benchmark::kSecond);
BENCHMARK_MAIN();
