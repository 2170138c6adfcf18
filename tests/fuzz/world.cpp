// SPDX-License-Identifier: MIT
// A world file is read or refused with std::invalid_argument, and so is the bench file that it is compiled
// to.
#include "sim/world.hpp"

#include <cstdint>
#include <stdexcept>
#include <string>

#include "fit/bench.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const sim::World world = sim::parse_world(std::string(reinterpret_cast<const char*>(data), size));
    (void)fit::parse_bench(sim::compile_world(world));
  } catch (const std::invalid_argument&) {
  }
  return 0;
}
