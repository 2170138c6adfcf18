// SPDX-License-Identifier: MIT
// Scans per second of the three engines alone, for a room of six targets with the stage standing or turning.
#include <benchmark/benchmark.h>

#include <filesystem>
#include <vector>

#include "sim/engine_factory.hpp"

namespace {

constexpr const char* worlds = RIG_SOURCE_DIR "/sim/worlds/";

void run(benchmark::State& state, const sim::EngineChoice& choice, double rate_rad_s) {
  const sim::SimulatedBench bench = sim::make_simulated_bench(choice);
  std::vector<std::uint32_t> range(1081), intensity(1081);
  const auto stage = [rate_rad_s](double time_s) {
    return sim::StageMoment{rate_rad_s * time_s, rate_rad_s};
  };
  double time_s = 0;
  for (auto unused : state) {
    bench.engine->scan(time_s, stage, range, intensity);
    benchmark::DoNotOptimize(range.data());
    time_s += 0.025;
  }
  state.SetItemsProcessed(state.iterations());
}

sim::EngineChoice room(const std::string& engine) {
  sim::EngineChoice choice;
  choice.bench_file = std::string(worlds) + "room.bench.json";
  choice.engine = engine;
  return choice;
}

sim::EngineChoice world(const std::string& name) {
  sim::EngineChoice choice;
  choice.world_file = std::string(worlds) + name + ".world.json";
  return choice;
}

void simple_standing(benchmark::State& state) { run(state, room("simple"), 0); }
void simple_turning(benchmark::State& state) { run(state, room("simple"), 0.3); }
void model_standing(benchmark::State& state) { run(state, room("model"), 0); }
void causal_plain(benchmark::State& state) { run(state, room("causal"), 0); }
void causal_everything(benchmark::State& state) { run(state, world("everything-at-once"), 0); }
void causal_turning(benchmark::State& state) { run(state, world("everything-at-once"), 0.3); }

BENCHMARK(simple_standing)->Name("engine/simple/standing");
BENCHMARK(simple_turning)->Name("engine/simple/turning");
BENCHMARK(model_standing)->Name("engine/model/standing");
BENCHMARK(causal_plain)->Name("engine/causal/plain");
BENCHMARK(causal_everything)->Name("engine/causal/everything");
BENCHMARK(causal_turning)->Name("engine/causal/turning");

}  // namespace

BENCHMARK_MAIN();
