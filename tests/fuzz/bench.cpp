// SPDX-License-Identifier: MIT
// A bench file is read or refused with std::invalid_argument; what was read survives being written.
#include "fit/bench/bench.hpp"

#include <cstdint>
#include <cstdlib>
#include <stdexcept>
#include <string>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const fit::Bench bench = fit::parse_bench(std::string(reinterpret_cast<const char*>(data), size));
    const fit::Bench again = fit::parse_bench(fit::to_json_text(bench));
    if (again.targets.size() != bench.targets.size() || again.known.size() != bench.known.size())
      std::abort();
  } catch (const std::invalid_argument&) {
  }
  return 0;
}
