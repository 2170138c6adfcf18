// SPDX-License-Identifier: MIT
// What comes from a Zaber stage's line, read as the answer to a command.
#include <cstdint>
#include <cstdlib>

#include "rig/stage/stage_reply.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  for (const int id : {0, 7, 42, 98}) {
    const auto reply = rig::zaber_reply(text, 1, 1, id);
    if (!reply) continue;
    if (reply->flag.size() != 2 || reply->data.empty() || reply->data.size() > size) std::abort();
    rig::whole_number(reply->data);
    // A damaged checksum must not pass: change one bit of the last but one hexadecimal digit's place.
    std::string damaged(text);
    if (damaged.size() > 3 && damaged[damaged.size() - 3] == ':') {
      damaged[damaged.size() - 1] = static_cast<char>(damaged.back() ^ 1);
      if (rig::zaber_reply(damaged, 1, 1, id)) std::abort();
    }
  }
  // Our own commands carry a sum that their reader accepts, whatever is in them.
  const std::string command = rig::zaber_command(std::string(text.substr(0, 40)), 1, 1, 42);
  unsigned sum = 0;
  const std::size_t colon = command.rfind(':');
  for (std::size_t i = 1; i < colon; ++i) sum += static_cast<unsigned char>(command[i]);
  if (((sum + std::strtoul(command.c_str() + colon + 1, nullptr, 16)) & 0xff) != 0) std::abort();
  return 0;
}
