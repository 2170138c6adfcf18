// SPDX-License-Identifier: MIT
#include "lidar/encoding.hpp"

namespace lidar {

char checksum(std::string_view line) {
  unsigned sum = 0;
  for (const char c : line) sum += static_cast<unsigned char>(c);
  return static_cast<char>((sum & 0x3F) + 0x30);
}

std::optional<std::uint64_t> decode_value(std::string_view characters) {
  if (characters.empty() || characters.size() > 11) return std::nullopt;
  // 11 characters are 66 bits: the first may only carry 4 of its 6.
  if (characters.size() == 11 && static_cast<unsigned char>(characters.front() - 0x30) > 0x0F)
    return std::nullopt;
  std::uint64_t value = 0;
  for (const char c : characters) {
    if (!is_data_character(c)) return std::nullopt;
    value = value << 6 | static_cast<std::uint64_t>(c - 0x30);
  }
  return value;
}

void append_value(std::string& out, std::uint64_t value, int characters) {
  for (int left = characters - 1; left >= 0; --left) {
    const int shift = 6 * left;
    out.push_back(static_cast<char>((shift < 64 ? value >> shift & 0x3F : 0) + 0x30));
  }
}

void append_checked_line(std::string& out, std::string_view line) {
  out += line;
  out += checksum(line);
  out += '\n';
}

}  // namespace lidar
