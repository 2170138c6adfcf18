// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace rig {

using Sha256State = std::array<std::uint32_t, 8>;
/// Takes whole blocks of 64 bytes into the state.
using DigestBlocks = void (*)(Sha256State& state, const std::uint8_t* blocks, std::size_t count);
/// By the processor's instructions for it where it has them, else as portable_digest().
[[nodiscard]] DigestBlocks fastest_digest();
[[nodiscard]] DigestBlocks portable_digest();

/// SHA-256 (FIPS 180-4) of what is fed to it piece by piece: the name certificates print for their data.
class Sha256 {
 public:
  void feed(const void* bytes, std::size_t size);
  void feed(std::string_view text) { feed(text.data(), text.size()); }
  /// The digest as 64 hexadecimal digits. Feeding after this begins no new digest: make a new object.
  [[nodiscard]] std::string hex();

 private:
  Sha256State state_ = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                        0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
  std::array<std::uint8_t, 64> pending_{};
  std::size_t pending_size_ = 0;
  std::uint64_t total_bytes_ = 0;
};

/// Of one text, as 64 hexadecimal digits.
[[nodiscard]] inline std::string sha256_of(std::string_view text) {
  Sha256 hash;
  hash.feed(text);
  return hash.hex();
}

}  // namespace rig
