// SPDX-License-Identifier: MIT
#include "lidar/scan_kernels.hpp"

#include <algorithm>

#include "lidar/encoding.hpp"

namespace lidar {
namespace {

/// Verifies one line and writes its 6-bit numbers.
bool open_line(const char* line, std::size_t characters, unsigned char* numbers) {
  unsigned sum = 0, outside = 0;
  for (std::size_t i = 0; i < characters; ++i) {
    const auto number = static_cast<unsigned char>(line[i] - 0x30);
    numbers[i] = number;
    sum += number;
    outside |= number;
  }
  // A full line's offsets of 0x30 add up to a multiple of 64, a shorter one's do not.
  sum += static_cast<unsigned>(characters) * 0x30;
  return outside < 0x40 && line[characters] == static_cast<char>((sum & 0x3F) + 0x30) &&
         line[characters + 1] == '\n';
}

std::uint32_t number_of(const unsigned char* digits) {
  return static_cast<std::uint32_t>(digits[0] << 12 | digits[1] << 6 | digits[2]);
}

bool decode_portably(const char* lines, const LineShape& shape, std::uint16_t* range,
                     std::uint16_t* intensity) {
  // Three lines end where a value ends.
  unsigned char numbers[LineGroups::characters];
  const std::size_t size = shape.with_intensity ? 6 : 3;
  bool right = true;
  std::size_t left = shape.characters();
  while (left > 0) {
    const std::size_t present = std::min(left, LineGroups::characters);
    for (std::size_t at = 0; at < present; at += line_characters) {
      const std::size_t characters = std::min(line_characters, present - at);
      right &= open_line(lines, characters, numbers + at);
      lines += characters + 2;
    }
    for (std::size_t at = 0; at < present; at += size) {
      const std::uint32_t mm = number_of(numbers + at);
      *range++ = static_cast<std::uint16_t>(mm < shape.least_mm || mm > shape.most_mm ? 0 : mm);
      if (shape.with_intensity)
        *intensity++ = static_cast<std::uint16_t>(std::min(number_of(numbers + at + 3), 65535u));
    }
    left -= present;
  }
  return right;
}

/// The last lines, filled up with zeros to three full ones that are right if, and only if, the lines are.
struct FullGroup {
  char bytes[LineGroups::bytes + 16];  // kernels may read a few bytes beyond

  FullGroup(const char* lines, std::size_t characters) {
    std::fill_n(bytes, sizeof bytes, '0');
    for (std::size_t at = 0; at < LineGroups::bytes; at += line_characters + 2)
      bytes[at + line_characters + 1] = '\n';
    const std::size_t whole = characters / line_characters, left = characters % line_characters;
    std::copy_n(lines, whole * (line_characters + 2), bytes);
    if (left == 0) return;
    const char* const short_line = lines + whole * (line_characters + 2);
    char* const line = bytes + whole * (line_characters + 2);
    std::copy_n(short_line, left, line);
    // Each character that was added has its share in the sum. A sum that is no character stays wrong.
    const auto sum = static_cast<unsigned char>(short_line[left] - 0x30);
    line[line_characters] =
        sum < 0x40 ? static_cast<char>(((sum + (line_characters - left) * '0') & 0x3F) + 0x30) : '\n';
    line[line_characters + 1] = short_line[left + 1];
  }
};

}  // namespace

std::size_t find_empty_line(std::string_view text) {
  const std::size_t found = text.find("\n\n");
  return found == std::string_view::npos ? text.size() : found;
}

bool available([[maybe_unused]] Kernel kernel) {
#ifdef __x86_64__
  if (kernel == Kernel::avx2) return __builtin_cpu_supports("avx2");
  if (kernel == Kernel::avx512)
    return __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl") &&
           __builtin_cpu_supports("avx512vbmi");
#endif
  return kernel == Kernel::portable;
}

Kernel fastest_kernel() {
  static const Kernel fastest = available(Kernel::avx512) ? Kernel::avx512
                                : available(Kernel::avx2) ? Kernel::avx2
                                                          : Kernel::portable;
  return fastest;
}

bool decode_lines(Kernel kernel, const char* lines, const LineShape& shape, std::uint16_t* range,
                  std::uint16_t* intensity) {
  const auto decode_groups = kernel == Kernel::avx512 ? decode_groups_avx512 : decode_groups_avx2;
  if (kernel == Kernel::portable || shape.values == 0) return decode_portably(lines, shape, range, intensity);
  // At least one character is left for the end: kernels may read a few bytes beyond their last line.
  const LineGroups groups{lines,          (shape.characters() - 1) / LineGroups::characters,
                          shape.least_mm, shape.most_mm,
                          range,          shape.with_intensity ? intensity : nullptr};
  const bool right = decode_groups(groups);
  const std::size_t done = groups.count * (shape.with_intensity ? 32 : 64);
  LineShape rest = shape;
  rest.values -= done;
  FullGroup full(lines + groups.count * LineGroups::bytes, rest.characters());
  std::uint16_t last_range[64], last_intensity[64];
  const bool right_to_the_end = decode_groups({full.bytes, 1, shape.least_mm, shape.most_mm, last_range,
                                               shape.with_intensity ? last_intensity : nullptr});
  std::copy_n(last_range, rest.values, range + done);
  if (shape.with_intensity) std::copy_n(last_intensity, rest.values, intensity + done);
  return right && right_to_the_end;
}

}  // namespace lidar
