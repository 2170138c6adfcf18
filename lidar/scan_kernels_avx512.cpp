// SPDX-License-Identifier: MIT
#include "lidar/scan_kernels.hpp"

#ifdef __x86_64__

#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"  // g++ 12's own header (gcc bug 105593)
#endif
#include <immintrin.h>

#include <array>
#include <cstring>

#define RIG_AVX512 __attribute__((target("avx512bw,avx512vl,avx512vbmi"), always_inline)) inline

namespace lidar {
namespace {

constexpr unsigned char nothing = 64 + 63;  // masked out below

/// Which of 128 numbers (two lines) go to a register of 16 values, four bytes each: the value's three,
/// nothing. Values lie `apart` numbers apart, from `first` on.
constexpr std::array<unsigned char, 64> places(int first, int apart) {
  std::array<unsigned char, 64> out{};
  for (int value = 0; value < 16; ++value)
    for (int byte = 0; byte < 4; ++byte)
      out[static_cast<std::size_t>(4 * value + byte)] =
          byte < 3 ? static_cast<unsigned char>(first + apart * value + byte) : nothing;
  return out;
}

// The first two registers come from lines 0 and 1, the others from lines 1 and 2.
alignas(64) constexpr std::array<std::array<unsigned char, 64>, 4> pair_places{places(0, 6), places(3, 6),
                                                                               places(32, 6), places(35, 6)};
alignas(64) constexpr std::array<std::array<unsigned char, 64>, 4> single_places{
    places(0, 3), places(48, 3), places(32, 3), places(80, 3)};

RIG_AVX512 __m512i open_line(const char* line, __m512i& outside, unsigned& wrong) {
  const __m512i numbers = _mm512_add_epi8(_mm512_set1_epi8(-0x30), _mm512_loadu_si512(line));
  outside = _mm512_or_si512(outside, numbers);
  const __m512i sums = _mm512_sad_epu8(numbers, _mm512_setzero_si512());
  const __m256i halves = _mm256_add_epi64(_mm512_castsi512_si256(sums), _mm512_extracti64x4_epi64(sums, 1));
  const __m128i quarters = _mm_add_epi64(_mm256_castsi256_si128(halves), _mm256_extracti128_si256(halves, 1));
  const auto sum = static_cast<unsigned>(_mm_cvtsi128_si32(quarters) + _mm_extract_epi32(quarters, 2));
  std::uint16_t end;
  std::memcpy(&end, line + 64, 2);
  wrong |= end ^ ((sum & 0x3F) + 0x30 + ('\n' << 8));
  return numbers;
}

/// 16 values of three numbers each, larger ones than 65535 as that.
RIG_AVX512 __m256i values_at(__m512i place, __m512i first, __m512i second) {
  const __m512i bytes = _mm512_maskz_permutex2var_epi8(0x7777777777777777, first, place, second);
  const __m512i halves = _mm512_maddubs_epi16(bytes, _mm512_set1_epi32(0x00010140));  // bytes 64, 1, 1, 0
  return _mm512_cvtusepi32_epi16(_mm512_madd_epi16(halves, _mm512_set1_epi32(0x00010040)));  // words 64, 1
}

RIG_AVX512 void put_within(std::uint16_t* to, __m256i mm, __m256i least, __m256i most) {
  const __mmask16 within = _mm256_cmpge_epu16_mask(mm, least) & _mm256_cmple_epu16_mask(mm, most);
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(to), _mm256_maskz_mov_epi16(within, mm));
}

}  // namespace

__attribute__((target("avx512bw,avx512vl,avx512vbmi"))) bool decode_groups_avx512(const LineGroups& groups) {
  const bool pairs = groups.intensity != nullptr;
  const auto& places_of = pairs ? pair_places : single_places;
  __m512i place[4];
  for (int i = 0; i < 4; ++i) place[i] = _mm512_load_si512(places_of[static_cast<std::size_t>(i)].data());
  const __m256i least = _mm256_set1_epi16(static_cast<short>(groups.least_mm));
  const __m256i most = _mm256_set1_epi16(static_cast<short>(groups.most_mm));
  __m512i outside = _mm512_setzero_si512();
  unsigned wrong = 0;
  const char* at = groups.at;
  for (std::size_t group = 0; group < groups.count; ++group, at += LineGroups::bytes) {
    const __m512i line0 = open_line(at, outside, wrong), line1 = open_line(at + 66, outside, wrong),
                  line2 = open_line(at + 132, outside, wrong);
    const __m256i values[4] = {values_at(place[0], line0, line1), values_at(place[1], line0, line1),
                               values_at(place[2], line1, line2), values_at(place[3], line1, line2)};
    if (pairs) {
      std::uint16_t* const intensity = groups.intensity + 32 * group;
      put_within(groups.range + 32 * group, values[0], least, most);
      put_within(groups.range + 32 * group + 16, values[2], least, most);
      _mm256_storeu_si256(reinterpret_cast<__m256i*>(intensity), values[1]);
      _mm256_storeu_si256(reinterpret_cast<__m256i*>(intensity + 16), values[3]);
    } else {
      for (std::size_t i = 0; i < 4; ++i)
        put_within(groups.range + 64 * group + 16 * i, values[i], least, most);
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
