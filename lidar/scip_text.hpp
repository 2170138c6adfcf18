// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

// The letters of SCIP 2.x (Hokuyo C-42-03320B): six bits a character, most significant first, each plus 0x30.
namespace lidar::scip {

inline constexpr int line_payload = 64;  ///< Characters of data in a line, before its checksum.

/// The character that closes a line: the sum of its bytes, six bits of it, plus 0x30.
[[nodiscard]] char checksum(std::string_view line);

/// True for 0x30..0x6F, the only bytes that data may hold. The six-bit sum cannot see bits 6 and 7; this can.
[[nodiscard]] constexpr bool is_data(char c) { return c >= 0x30 && c <= 0x6f; }

/// `value` in `characters` letters; higher bits are cut off.
[[nodiscard]] std::string encode(std::uint64_t value, int characters);
void append_encoded(std::string& out, std::uint64_t value, int characters);

/// The value of letters that were checked with is_data().
[[nodiscard]] constexpr std::uint64_t decode(std::string_view letters) {
  std::uint64_t value = 0;
  for (const char c : letters) value = value << 6 | static_cast<std::uint64_t>(c - 0x30);
  return value;
}

/// Appends `payload` cut into lines of 64 letters, each with its checksum and LF.
void append_block(std::string& out, std::string_view payload);

/// Appends `text`, its checksum and LF.
void append_line(std::string& out, std::string_view text);

}  // namespace lidar::scip
