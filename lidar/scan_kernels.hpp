// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

namespace lidar {

/// Where the first LF LF begins; the text's size when there is none.
[[nodiscard]] std::size_t find_empty_line(std::string_view text);

/// What the data lines of one scan hold: 64 characters a line, its sum and LF; the last line may be shorter.
struct LineShape {
  std::size_t values = 0;                       ///< Ranges; as many intensities follow them, one by one.
  bool with_intensity = true;                   ///< Six characters a value, else three.
  std::uint16_t least_mm = 0, most_mm = 65534;  ///< Ranges outside become 0.

  [[nodiscard]] std::size_t characters() const { return values * (with_intensity ? 6 : 3); }
  [[nodiscard]] std::size_t bytes() const { return characters() + 2 * ((characters() + 63) / 64); }
};

/// Ways to decode, of which a processor may not know all. All give the same.
enum class Kernel { portable, avx2, avx512 };
[[nodiscard]] bool available(Kernel kernel);
[[nodiscard]] Kernel fastest_kernel();

/// Verifies the lines' characters, sums and ends, and decodes them: ranges outside the limits as 0,
/// intensities above 65535 as 65535. False when anything is wrong; what was written then means nothing.
/// `lines` holds shape.bytes() bytes, `range` room for shape.values, `intensity` as well (unused without
/// intensity).
[[nodiscard]] bool decode_lines(Kernel kernel, const char* lines, const LineShape& shape,
                                std::uint16_t* range, std::uint16_t* intensity);

/// Three full lines are 192 characters, which is 32 pairs or 64 ranges: what the vector kernels do at once.
struct LineGroups {
  static constexpr std::size_t lines = 3, bytes = 66 * lines, characters = 64 * lines;
  const char* at;
  std::size_t count;
  std::uint16_t least_mm, most_mm;
  std::uint16_t *range, *intensity;  ///< No intensity: ranges only.
};
[[nodiscard]] bool decode_groups_avx2(const LineGroups& groups);
[[nodiscard]] bool decode_groups_avx512(const LineGroups& groups);

}  // namespace lidar
