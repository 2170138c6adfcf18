// SPDX-License-Identifier: MIT
// Whatever a session holds is explained to the end, or refused with std::invalid_argument: no crash, no
// figure that is not finite, and in bounded time (libFuzzer's -timeout).
#include <cstdint>
#include <cstdlib>
#include <span>
#include <stdexcept>

#include "../support/finite.hpp"
#include "../support/session_of_bytes.hpp"
#include "fit/explain/explanation.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const SyntheticRecording recording = SessionOfBytes(std::span(data, size)).recording();
    const fit::explain::Explanation e = fit::explain::explain({&recording}, {});
    if (!not_finite(to_json(e)).empty()) std::abort();
  } catch (const std::invalid_argument&) {
  }
  return 0;
}
