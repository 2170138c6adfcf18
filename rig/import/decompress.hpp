// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace rig {

/// What came out of a compressed block, and whether it came out whole. A block that is cut or damaged gives
/// all bytes before the damage.
struct Decompressed {
  std::vector<std::uint8_t> bytes;
  bool whole = false;
};

// All stop, not whole, as soon as more than `limit_bytes` come out: a few bytes can promise gigabytes.
[[nodiscard]] Decompressed decompress_zstd(std::span<const std::uint8_t> block, std::size_t limit_bytes);
[[nodiscard]] Decompressed decompress_lz4(std::span<const std::uint8_t> block, std::size_t limit_bytes);
[[nodiscard]] Decompressed decompress_bz2(std::span<const std::uint8_t> block, std::size_t limit_bytes);

[[nodiscard]] bool is_zstd(std::span<const std::uint8_t> bytes);

/// Unpacks a zstd file into another, piece by piece. Throws UsageError when it cannot be read, is damaged, or
/// the disk is full; of a file that is cut, what came before the cut is written and false returned.
bool decompress_zstd_file(const std::string& from, const std::string& to);

}  // namespace rig
