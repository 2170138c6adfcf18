// SPDX-License-Identifier: MIT
#include "lidar/scip_text.hpp"

namespace lidar::scip {

char checksum(std::string_view line) {
  unsigned sum = 0;
  for (const char c : line) sum += static_cast<unsigned char>(c);
  return static_cast<char>((sum & 0x3f) + 0x30);
}

void append_encoded(std::string& out, std::uint64_t value, int characters) {
  for (int shift = 6 * (characters - 1); shift >= 0; shift -= 6)
    out += static_cast<char>((shift < 64 ? value >> shift & 0x3f : 0) + 0x30);
}

std::string encode(std::uint64_t value, int characters) {
  std::string out;
  append_encoded(out, value, characters);
  return out;
}

void append_line(std::string& out, std::string_view text) {
  out += text;
  out += checksum(text);
  out += '\n';
}

void append_block(std::string& out, std::string_view payload) {
  for (std::size_t at = 0; at < payload.size(); at += line_payload)
    append_line(out, payload.substr(at, line_payload));
}

}  // namespace lidar::scip
