// SPDX-License-Identifier: MIT
// Explaining sessions of growing size, all mechanisms: time, and the most memory held at any moment.
#include <benchmark/benchmark.h>

#include <chrono>
#include <fstream>
#include <string>

#include "../support/imagined_room.hpp"
#include "fit/explain/explanation.hpp"

namespace {

constexpr int beams = 1081, fewest_captures = 10;

/// What Linux counts as the most memory ever held starts anew.
void forget_peak() { std::ofstream("/proc/self/clear_refs") << "5"; }

double peak_mb() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.starts_with("VmHWM:")) return std::stod(line.substr(6)) / 1e3;
  return 0;
}

struct Timed {
  fit::explain::Explanation explanation;
  double took_s = 0;
  [[nodiscard]] double us_per_cell() const { return 1e6 * took_s / static_cast<double>(explanation.cells); }
};

/// A room in which every beam points a little elsewhere than the bench says.
SyntheticRecording room_of(int captures) {
  ImaginedRoom room;
  room.every_beam = 1;
  room.captures = captures;
  room.bend = [](double beam) { return 0.001 * std::sin(beam + 1); };
  return room.record();
}

Timed timed(const SyntheticRecording& recording) {
  const auto from = std::chrono::steady_clock::now();
  Timed t{fit::explain::explain({&recording}, {})};
  t.took_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - from).count();
  return t;
}

void explain_room(benchmark::State& state) {
  const auto captures = static_cast<int>(state.range(0) / beams);
  const SyntheticRecording recording = room_of(captures);
  Timed t;
  forget_peak();
  for (auto _ : state) t = timed(recording);
  if (t.explanation.mechanisms.size() != 1 ||
      t.explanation.mechanisms.front().mechanism->id != "encoder-eccentricity")
    state.SkipWithError("not what was concealed");
  state.counters["cells"] = static_cast<double>(t.explanation.cells);
  state.counters["us_per_cell"] = t.us_per_cell();
  state.counters["peak_mb"] = peak_mb();
  state.counters["peak_mb at most"] = 1000;
  if (captures > fewest_captures) {  // grows no faster than the cells do
    static const double smallest = timed(room_of(fewest_captures)).us_per_cell();
    state.counters["us_per_cell at most"] = smallest;
  }
  if (captures == 47) {
    state.counters["seconds"] = t.took_s;
    state.counters["seconds at most"] = 20;
  }
}

}  // namespace

BENCHMARK(explain_room)
    ->Name("explain a session")
    ->Arg(fewest_captures* beams)
    ->Arg(47 * beams)
    ->Arg(926 * beams)
    ->Iterations(1)
    ->Repetitions(1)
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kSecond);
BENCHMARK_MAIN();
