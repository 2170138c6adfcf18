// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace lidar {

/// Characters of data in a full line of a reply.
inline constexpr std::size_t line_characters = 64;

/// The sum that ends every checked SCIP line: the bytes' sum modulo 64, plus 0x30.
[[nodiscard]] char checksum(std::string_view line);

/// Whether a byte can occur in encoded data: 0x30 to 0x6F. The 6-bit sum cannot see bits 6 and 7; this can.
[[nodiscard]] constexpr bool is_data_character(char c) { return static_cast<unsigned char>(c - 0x30) < 0x40; }

/// A number of 6 bits a character, most significant first: 2 characters for short distances, 3 for distances
/// and intensities, 4 for milliseconds, 11 for microseconds. Empty for other lengths than 1 to 11, for a byte
/// that is not a data character and for a number above 64 bits.
[[nodiscard]] std::optional<std::uint64_t> decode_value(std::string_view characters);

/// Appends the lowest 6 x `characters` bits of a number, most significant first.
void append_value(std::string& out, std::uint64_t value, int characters);

/// Appends a line with its sum and LF.
void append_checked_line(std::string& out, std::string_view line);

}  // namespace lidar
