// SPDX-License-Identifier: MIT
// A correction is read or refused with std::invalid_argument; what was read is written and read again
// unchanged.
#include "fit/range/correction.hpp"

#include <cstdint>
#include <cstdlib>
#include <stdexcept>
#include <string>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const fit::Correction correction =
        fit::parse_correction(std::string(reinterpret_cast<const char*>(data), size));
    const std::string text = fit::to_json_text(correction);
    if (fit::to_json_text(fit::parse_correction(text)) != text) std::abort();
    for (const double range : {0.0, 21.0, 1500.0, 65000.0})
      for (const double counts : {0.0, 300.0, 65535.0}) {
        (void)correction.apply(range, counts);
        (void)correction.u(range, counts);
      }
  } catch (const std::invalid_argument&) {
  }
  return 0;
}
