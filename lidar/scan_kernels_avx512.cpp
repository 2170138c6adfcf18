// SPDX-License-Identifier: MIT
#include "lidar/scan_kernels.hpp"

#ifdef __x86_64__

#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"  // g++ 12's own header (gcc bug 105593)
#endif
#include <immintrin.h>

#include <algorithm>
#include <array>
#include <cstring>

#define RIG_AVX512_TARGET target("avx512bw,avx512vl,avx512vbmi")
#define RIG_AVX512 __attribute__((RIG_AVX512_TARGET, always_inline)) inline

namespace lidar {
namespace {

// 48 characters, 16 values, are a chunk; three lines have four. Those in the middle have a line's end inside.
constexpr int chunks = 4, chunk_characters = 48;

constexpr int place_of(int character) { return character + 2 * (character / 64); }
/// Where 64 bytes that hold the chunk are read, inside the three lines.
constexpr int begin_of(int chunk) {
  return std::min(place_of(chunk_characters * chunk), static_cast<int>(LineGroups::bytes) - 64);
}

/// For each chunk, which of its bytes go where: four bytes a value, the fourth of which weighs nothing later;
/// of pairs eight ranges before eight intensities.
constexpr std::array<std::array<unsigned char, 64>, chunks> orders(bool pairs) {
  std::array<std::array<unsigned char, 64>, chunks> out{};
  for (int chunk = 0; chunk < chunks; ++chunk)
    for (int value = 0; value < 16; ++value)
      for (int digit = 0; digit < 3; ++digit) {
        const int from = pairs ? value % 8 * 2 + value / 8 : value;
        const int character = chunk_characters * chunk + 3 * from + digit;
        out[static_cast<std::size_t>(chunk)][static_cast<std::size_t>(4 * value + digit)] =
            static_cast<unsigned char>(place_of(character) - begin_of(chunk));
      }
  return out;
}
alignas(64) constexpr auto single_orders = orders(false), pair_orders = orders(true);

/// Gathers what is wrong with three full lines.
RIG_AVX512 void verify(const char* lines, __m512i& outside, std::uint64_t& wrong) {
  __m512i sums = _mm512_setzero_si512();  // of eight bytes each, those of every line in 16 bits of its own
  std::uint64_t ends = 0;
  for (unsigned line = 0; line < LineGroups::lines; ++line) {
    const __m512i characters = _mm512_loadu_si512(lines + 66 * line);
    outside = _mm512_or_si512(outside, _mm512_add_epi8(_mm512_set1_epi8(-0x30), characters));
    // The 64 offsets of 0x30 add up to a multiple of 64.
    const __m512i eights = _mm512_sad_epu8(characters, _mm512_setzero_si512());
    sums = _mm512_or_si512(sums, _mm512_slli_epi64(eights, 16 * line));
    std::uint16_t end;
    std::memcpy(&end, lines + 66 * line + 64, 2);
    ends |= std::uint64_t{end} << (16 * line);
  }
  const __m256i halves = _mm256_add_epi64(_mm512_castsi512_si256(sums), _mm512_extracti64x4_epi64(sums, 1));
  const __m128i quarters = _mm_add_epi64(_mm256_castsi256_si128(halves), _mm256_extracti128_si256(halves, 1));
  const auto sum = static_cast<std::uint64_t>(
      _mm_cvtsi128_si64(_mm_add_epi64(quarters, _mm_unpackhi_epi64(quarters, quarters))));
  wrong |= ends ^ ((sum & 0x003F003F003F) + 0x0A300A300A30);  // '0' and LF
}

/// A chunk's 16 values.
RIG_AVX512 __m512i values_of(const char* chunk, __m512i order) {
  const __m512i bytes = _mm512_permutexvar_epi8(order, _mm512_loadu_si512(chunk));
  const __m512i numbers = _mm512_add_epi8(_mm512_set1_epi8(-0x30), bytes);
  const __m512i halves = _mm512_maddubs_epi16(numbers, _mm512_set1_epi32(0x00010140));  // bytes 64, 1, 1, 0
  return _mm512_madd_epi16(halves, _mm512_set1_epi32(0x00010040));                      // words 64, 1
}

struct Limits {
  __m512i least, span;
};

/// For 32 values, those of intensities (the upper half of pairs) without limits.
RIG_AVX512 Limits limits_of(const LineGroups& groups) {
  const bool none = groups.most_mm < groups.least_mm;  // then only 0 is let through
  const auto least = static_cast<short>(none ? 0 : groups.least_mm),
             span = static_cast<short>(none ? 0 : groups.most_mm - groups.least_mm);
  const __mmask32 ranges = groups.intensity ? 0x0000FFFF : 0xFFFFFFFF;
  return {_mm512_maskz_set1_epi16(ranges, least),
          _mm512_mask_set1_epi16(_mm512_set1_epi16(-1), ranges, span)};
}

/// Two chunks' values in order, larger ones than 65535 as that, those outside the limits as 0.
RIG_AVX512 __m512i joined(__m512i low, __m512i high, const Limits& limits, __m512i order) {
  const __m512i values = _mm512_permutexvar_epi64(order, _mm512_packus_epi32(low, high));
  const __mmask32 within = _mm512_cmple_epu16_mask(_mm512_sub_epi16(values, limits.least), limits.span);
  return _mm512_maskz_mov_epi16(within, values);
}

}  // namespace

__attribute__((RIG_AVX512_TARGET)) bool decode_groups_avx512(const LineGroups& groups) {
  const bool pairs = groups.intensity != nullptr;
  const auto& orders_of = pairs ? pair_orders : single_orders;
  const Limits limits = limits_of(groups);
  // Packing takes four values of one chunk and four of the other by turns.
  const __m512i unpacked =
      pairs ? _mm512_setr_epi64(0, 2, 1, 3, 4, 6, 5, 7) : _mm512_setr_epi64(0, 2, 4, 6, 1, 3, 5, 7);
  __m512i order[chunks];
  for (std::size_t i = 0; i < chunks; ++i) order[i] = _mm512_load_si512(orders_of[i].data());
  __m512i outside = _mm512_setzero_si512();
  std::uint64_t wrong = 0;
  const char* at = groups.at;
  for (std::size_t group = 0; group < groups.count; ++group, at += LineGroups::bytes) {
    verify(at, outside, wrong);
    __m512i value[chunks];
    for (int i = 0; i < chunks; ++i) value[i] = values_of(at + begin_of(i), order[i]);
    for (std::size_t i = 0; i < 2; ++i) {
      const __m512i both = joined(value[2 * i], value[2 * i + 1], limits, unpacked);
      if (pairs) {
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(groups.range + 32 * group + 16 * i),
                            _mm512_castsi512_si256(both));
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(groups.intensity + 32 * group + 16 * i),
                            _mm512_extracti64x4_epi64(both, 1));
      } else {
        _mm512_storeu_si512(groups.range + 64 * group + 32 * i, both);
      }
    }
  }
  const bool inside = _mm512_test_epi8_mask(outside, _mm512_set1_epi8(static_cast<char>(0xC0))) == 0;
  return inside && wrong == 0;
}

}  // namespace lidar

#else

namespace lidar {
bool decode_groups_avx512(const LineGroups&) { return false; }
}  // namespace lidar

#endif
