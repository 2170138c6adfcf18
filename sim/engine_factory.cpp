// SPDX-License-Identifier: MIT
#include "sim/engine_factory.hpp"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

#include "fit/bench/empirical.hpp"
#include "sim/model_engine.hpp"
#include "sim/simple_engine.hpp"
#include "sim/world.hpp"

namespace sim {
namespace {

fit::Bench read_bench(const std::string& path) {
  std::ifstream in(path);
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  if (!in.is_open())
    throw std::invalid_argument("cannot read the bench file " + path + ": check the name and the permission");
  return fit::parse_bench_file(text, path);
}

std::string engine_for(const EngineChoice& choice) {
  if (choice.engine != "auto") return choice.engine;
  return choice.world_file.empty() ? "" : "causal";
}

bool knows_physics(const fit::Bench& bench) {
  return !fit::empirical_functions(bench).empty() ||
         std::ranges::any_of(bench.known, [](const auto& known) { return known.mechanism != "range-noise"; });
}

}  // namespace

fit::Bench take_play(World& world) {
  fit::Bench bench = world.bench;
  if (world.stage.play_rad > 0)
    bench.document.change([&](nlohmann::json& document) {
      document["stage"]["physics"]["backlash_deg"] = world.stage.play_rad * fit::deg_per_rad;
    });
  world.stage.play_rad = 0;
  return bench;
}

SimulatedBench make_simulated_bench(const EngineChoice& choice) {
  if (choice.world_file.empty() && choice.bench_file.empty())
    throw std::invalid_argument("nothing to simulate: give a bench file (--bench) or a world file (--world)");
  const std::string engine = engine_for(choice);
  if (choice.repeatable && !choice.world_file.empty())
    throw std::invalid_argument("--repeatable is for benches that the simple engine serves");
  SimulatedBench simulated;
  if (engine == "causal") {
    std::optional<fit::Bench> operators;
    if (!choice.bench_file.empty()) operators = read_bench(choice.bench_file);
    World world;
    if (choice.world_file.empty()) {
      world.bench = *operators;
    } else {
      world = load_world(choice.world_file, operators);
    }
    simulated.scene = take_play(world);
    simulated.engine_name = engine;
    simulated.engine = make_causal_engine(world, choice.seed);
    return simulated;
  }
  if (!choice.world_file.empty())
    throw std::invalid_argument("a world file needs the causal engine, not \"" + engine + "\"");
  // The operator's bench file is the scene; a truth file, where given, is what the bench really is.
  simulated.scene = read_bench(choice.bench_file);
  if (!choice.truth_file.empty()) simulated.scene = read_bench(choice.truth_file);
  simulated.engine_name = !engine.empty() ? engine : knows_physics(simulated.scene) ? "model" : "simple";
  if (simulated.engine_name == "model") {
    simulated.engine = make_model_engine(simulated.scene, choice.seed);
  } else {
    SimpleOptions options = simple_options(simulated.scene);
    options.repeatable = choice.repeatable;
    simulated.engine = std::make_shared<SimpleEngine>(simulated.scene, options, choice.seed);
  }
  return simulated;
}

}  // namespace sim
