// SPDX-License-Identifier: MIT
// What comes from the line of a SHOT, a GSC or a Falcon, read as a status.
#include <cmath>
#include <cstdint>
#include <cstdlib>

#include "rig/stage/stage_reply.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view line(reinterpret_cast<const char*>(data), size);
  for (int axis = 0; axis <= 5; ++axis) {
    const auto status = rig::shot_status(line, axis);
    if (status && (!(std::abs(status->position) < 1e10) || axis < 1 || axis > status->axes)) std::abort();
  }
  const auto falcon = rig::falcon_status(line);
  if (falcon && !(falcon->deg >= 0 && falcon->deg <= 360)) std::abort();
  rig::shot_acknowledgement(line);
  return 0;
}
