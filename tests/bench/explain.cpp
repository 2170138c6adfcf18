// SPDX-License-Identifier: MIT
// Explaining sessions of growing size, all mechanisms: time, and the most memory held at any moment.
#include <benchmark/benchmark.h>

#include <chrono>
#include <fstream>
#include <string>

#include "../support/imagined_room.hpp"
#include "fit/explain/explanation.hpp"

namespace {

constexpr int beams = 1081;
double smallest_us_per_cell = 0;  ///< Of the smallest session, which comes first.

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
  const auto from = std::chrono::steady_clock::now();
  for (auto _ : state) explanation = fit::explain::explain({&recording}, {});
  const double took_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - from).count();
  if (explanation.mechanisms.size() != 1 ||
      explanation.mechanisms.front().mechanism->id != "encoder-eccentricity")
    state.SkipWithError("not what was concealed");
  const auto cells = static_cast<double>(explanation.cells);
  state.counters["cells"] = cells;
  state.counters["us_per_cell"] = 1e6 * took_s / cells;
  if (smallest_us_per_cell > 0)
    state.counters["us_per_cell at most"] = smallest_us_per_cell;  // grows no faster than the cells do
  else
    smallest_us_per_cell = 1e6 * took_s / cells;
  state.counters["peak_mb"] = peak_mb();
  state.counters["peak_mb at most"] = 1000;
  if (state.range(0) == 47 * beams) {
    state.counters["seconds"] = took_s;
    state.counters["seconds at most"] = 20;
  }
}

}  // namespace

BENCHMARK(explain_room)
    ->Name("explain a session")
    ->Arg(10 * beams)
    ->Arg(47 * beams)
    ->Arg(926 * beams)
    ->Iterations(1)
    ->Repetitions(1)  // the sizes are compared in their order
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kSecond);
BENCHMARK_MAIN();
