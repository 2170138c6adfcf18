// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "fit/bench/bench.hpp"
#include "sim/engine.hpp"

namespace sim {

/// What is to be simulated, as the command line says it.
struct EngineChoice {
  std::string bench_file;       ///< What the operator knows; may be empty beside a world.
  std::string truth_file;       ///< Bench file of what is really there; empty: the bench file.
  std::string world_file;       ///< Causes (docs/develop/worlds.md); empty: none.
  std::string engine = "auto";  ///< "simple", "model", "causal", or "auto": whichever the files ask for.
  std::uint64_t seed = 1;
  bool repeatable = false;  ///< SimpleOptions::repeatable; the simple engine only.
};

struct World;

/// A bench that is simulated: its scene, with what the stage's simulator reads from it, and its engine.
struct SimulatedBench {
  fit::Bench scene;
  std::string engine_name;
  std::shared_ptr<Engine> engine;
};

/// Reads the files and makes the engine. "auto" takes the causal engine for a world, the model engine for a
/// bench that knows more than range noise, the simple engine otherwise. Throws std::invalid_argument naming
/// file and place.
[[nodiscard]] SimulatedBench make_simulated_bench(const EngineChoice& choice);

/// The bench of a world as the stage's simulator needs it: gear play is a matter of the stage's motion, so it
/// stands under the stage's physics and no longer in the world.
[[nodiscard]] fit::Bench take_play(World& world);

}  // namespace sim
