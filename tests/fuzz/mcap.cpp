// SPDX-License-Identifier: MIT
#include "rig/import/mcap.hpp"

#include <sstream>

#include "rig/errors.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::istringstream in(std::string(reinterpret_cast<const char*>(data), size));
  try {
    (void)rig::read_mcap(in,
                         [](const rig::McapMessage& message) { return message.data.size() < (1u << 20); });
  } catch (const rig::UsageError&) {
  }
  return 0;
}
