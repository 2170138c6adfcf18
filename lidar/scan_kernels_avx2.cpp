// SPDX-License-Identifier: MIT
#include "lidar/scan_kernels.hpp"

#ifdef __x86_64__

#include <immintrin.h>

#include <array>
#include <cstring>

#define RIG_AVX2 __attribute__((target("avx2"), always_inline)) inline

namespace lidar {
namespace {

// Twelve characters, four values, are a chunk; three lines have 16. A chunk that begins in one line and ends
// in the next has the sum and LF in its middle.
constexpr std::size_t chunks = LineGroups::characters / 12;

constexpr std::size_t place_of(std::size_t character) { return character + 2 * (character / 64); }

/// For each chunk, how its bytes go to four values of four bytes each; ranges before intensities for pairs.
constexpr std::array<std::array<char, 16>, chunks> orders(bool pairs) {
  std::array<std::array<char, 16>, chunks> out{};
  for (std::size_t chunk = 0; chunk < chunks; ++chunk)
    for (std::size_t value = 0; value < 4; ++value)
      for (std::size_t digit = 0; digit < 4; ++digit) {
        const std::size_t from = pairs ? (value % 2 * 2 + value / 2) : value;
        const std::size_t character = 12 * chunk + 3 * from + digit;
        out[chunk][4 * value + digit] =
            digit < 3 ? static_cast<char>(place_of(character) - place_of(12 * chunk)) : char{-1};
      }
  return out;
}
alignas(16) constexpr auto single_orders = orders(false), pair_orders = orders(true);

RIG_AVX2 __m256i load32(const char* from) {
  return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(from));
}
RIG_AVX2 __m256i load16(const char* low, const char* high) {
  return _mm256_inserti128_si256(
      _mm256_castsi128_si256(_mm_loadu_si128(reinterpret_cast<const __m128i*>(low))),
      _mm_loadu_si128(reinterpret_cast<const __m128i*>(high)), 1);
}

/// Gathers what is wrong with a full line.
RIG_AVX2 void verify(const char* line, __m256i& outside, unsigned& wrong) {
  const __m256i offset = _mm256_set1_epi8(-0x30);
  const __m256i low = _mm256_add_epi8(offset, load32(line)),
                high = _mm256_add_epi8(offset, load32(line + 32));
  outside = _mm256_or_si256(outside, _mm256_or_si256(low, high));
  // Two numbers below 64 fit a byte; where they are not below 64, `outside` tells.
  const __m256i sums = _mm256_sad_epu8(_mm256_add_epi8(low, high), _mm256_setzero_si256());
  const __m128i halves = _mm_add_epi64(_mm256_castsi256_si128(sums), _mm256_extracti128_si256(sums, 1));
  const auto sum = static_cast<unsigned>(_mm_cvtsi128_si32(halves) + _mm_extract_epi16(halves, 4));
  std::uint16_t end;
  std::memcpy(&end, line + 64, 2);
  wrong |= end ^ ((sum & 0x3F) + 0x30 + ('\n' << 8));
}

/// Two chunks to eight values.
RIG_AVX2 __m256i eight_values(const char* lines, const std::array<char, 16>* order, std::size_t low,
                              std::size_t high) {
  const __m256i bytes = _mm256_shuffle_epi8(load16(lines + place_of(12 * low), lines + place_of(12 * high)),
                                            load16(order[low].data(), order[high].data()));
  // The fourth byte of each value weighs nothing.
  const __m256i numbers = _mm256_add_epi8(bytes, _mm256_set1_epi8(-0x30));
  const __m256i halves = _mm256_maddubs_epi16(numbers, _mm256_set1_epi32(0x00010140));  // bytes 64, 1, 1, 0
  return _mm256_madd_epi16(halves, _mm256_set1_epi32(0x00010040));                      // words 64, 1
}

/// Four chunks, from the first on, to 16 values; those above 65535 as that.
RIG_AVX2 __m256i sixteen_values(const char* lines, const std::array<char, 16>* order, std::size_t first) {
  return _mm256_packus_epi32(eight_values(lines, order, first, first + 2),
                             eight_values(lines, order, first + 1, first + 3));
}

RIG_AVX2 __m256i keep_within(__m256i mm, __m256i least, __m256i most) {
  const __m256i clamped = _mm256_min_epu16(_mm256_max_epu16(mm, least), most);
  return _mm256_and_si256(mm, _mm256_cmpeq_epi16(clamped, mm));
}

}  // namespace

__attribute__((target("avx2"))) bool decode_groups_avx2(const LineGroups& groups) {
  const __m256i least = _mm256_set1_epi16(static_cast<short>(groups.least_mm));
  const __m256i most = _mm256_set1_epi16(static_cast<short>(groups.most_mm));
  __m256i outside = _mm256_setzero_si256();
  unsigned wrong = 0;
  const char* at = groups.at;
  for (std::size_t group = 0; group < groups.count; ++group, at += LineGroups::bytes) {
    for (std::size_t line = 0; line < LineGroups::lines; ++line) verify(at + 66 * line, outside, wrong);
    for (std::size_t i = 0; i < chunks / 4; ++i) {
      if (!groups.intensity) {
        const __m256i values = sixteen_values(at, single_orders.data(), 4 * i);
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(groups.range + 64 * group + 16 * i),
                            keep_within(values, least, most));
        continue;
      }
      // r0 r1 i0 i1 r2 r3 i2 i3 | r4 r5 ... becomes r0 ... r7 | i0 ... i7
      constexpr int middle_swapped = _MM_SHUFFLE(3, 1, 2, 0);
      const __m256i mixed = sixteen_values(at, pair_orders.data(), 4 * i);
      const __m256i parted =
          _mm256_permute4x64_epi64(_mm256_shuffle_epi32(mixed, middle_swapped), middle_swapped);
      const __m256i kept = keep_within(parted, least, most);
      _mm_storeu_si128(reinterpret_cast<__m128i*>(groups.range + 32 * group + 8 * i),
                       _mm256_castsi256_si128(kept));
      _mm_storeu_si128(reinterpret_cast<__m128i*>(groups.intensity + 32 * group + 8 * i),
                       _mm256_extracti128_si256(parted, 1));
    }
  }
  const bool inside = _mm256_testz_si256(outside, _mm256_set1_epi8(static_cast<char>(0xC0))) != 0;
  return inside && wrong == 0;
}

}  // namespace lidar

#else

namespace lidar {
bool decode_groups_avx2(const LineGroups&) { return false; }
}  // namespace lidar

#endif
