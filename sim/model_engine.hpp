// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <memory>

#include "fit/bench/bench.hpp"
#include "sim/engine.hpp"

namespace sim {

/// The twin: simulates with the effect-level mechanisms of fit/ that the bench knows, through the same
/// functions that the fitter uses. Every beam is cast again from the true place at the true angle, so
/// geometric effects are exact and not linearised.
///
/// What the bench lists under `empirical` acts beside them. Echo strength is the simple engine's law ("sim"
/// in the bench file) unless the bench has "sim": {"intensity": {...}} (docs/develop/simulator.md). Without
/// `motion-skew` among the known mechanisms all beams of a scan are taken at the angle of its start, as the
/// session format says. Throws std::invalid_argument for a mechanism or target that does not exist.
std::unique_ptr<Engine> make_model_engine(const fit::Bench& bench, std::uint64_t seed);

}  // namespace sim
