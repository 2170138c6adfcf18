// SPDX-License-Identifier: MIT
// Explaining sessions of growing size, all mechanisms: time, and the most memory held at any moment.
#include <benchmark/benchmark.h>

#include <fstream>
#include <string>

#include "../support/imagined_room.hpp"
#include "fit/explain/explanation.hpp"

namespace {

constexpr int beams = 1081;

/// What Linux counts as the most memory ever held starts anew.
void forget_peak() { std::ofstream("/proc/self/clear_refs") << "5"; }

double peak_mb() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.starts_with("VmHWM:")) return std::stod(line.substr(6)) / 1e3;
  return 0;
}

/// A room in which every beam points a little elsewhere than the bench says.
void explain_room(benchmark::State& state) {
  ImaginedRoom room;
  room.every_beam = 1;
  room.captures = static_cast<int>(state.range(0) / beams);
  room.bend = [](double beam) { return 0.001 * std::sin(beam + 1); };
  const SyntheticRecording recording = room.record();
  fit::explain::Explanation explanation;
  forget_peak();
  for (auto _ : state) explanation = fit::explain::explain({&recording}, {});
  if (explanation.mechanisms.size() != 1 ||
      explanation.mechanisms.front().mechanism->id != "encoder-eccentricity")
    state.SkipWithError("not what was concealed");
  state.SetItemsProcessed(static_cast<std::int64_t>(explanation.cells));
  state.counters["cells"] = static_cast<double>(explanation.cells);
  state.counters["peak_mb"] = peak_mb();
}

}  // namespace

BENCHMARK(explain_room)
    ->Name("explain a session")
    ->Arg(10 * beams)
    ->Arg(47 * beams)
    ->Arg(926 * beams)
    ->Iterations(1)
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kSecond);
BENCHMARK_MAIN();
