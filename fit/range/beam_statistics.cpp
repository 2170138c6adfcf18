// SPDX-License-Identifier: MIT
#include "fit/range/beam_statistics.hpp"

#include <algorithm>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace fit {
namespace {

constexpr std::size_t block_scans = 16, lanes = 16;  // an even number; 16-bit values in a vector

/// A block of scans, and what it is to be added to.
struct Block {
  const std::uint16_t* rows;
  std::size_t beams;  ///< And length of a row: a multiple of `lanes`.
  const std::uint16_t* first;
  std::uint16_t* last;
  std::uint32_t* count;
  std::int64_t *sum, *square, *product;
};

/// What a range differs from the beam's first; 0 where there is none, which then adds nothing to any sum.
std::int32_t deviation(std::uint16_t range, std::uint16_t first) { return range == 0 ? 0 : range - first; }

void add_portably(const Block& block, std::size_t from, std::size_t to) {
  for (std::size_t scan = 0; scan < block_scans; ++scan) {
    const std::uint16_t* const row = block.rows + scan * block.beams;
    for (std::size_t k = from; k < to; ++k) {
      const std::int64_t now = deviation(row[k], block.first[k]);
      block.sum[k] += now;
      block.square[k] += now * now;
      block.product[k] += now * deviation(block.last[k], block.first[k]);
      block.count[k] += row[k] != 0 ? 1 : 0;
      block.last[k] = row[k] != 0 ? row[k] : block.last[k];
    }
  }
}

#if defined(__x86_64__)
#define RIG_AVX2 [[gnu::target("avx2"), gnu::always_inline]] inline

// Deviations up to here leave room for the squares of a whole block in 32 bits.
constexpr short near_mm = 8191;
static_assert(std::int64_t{near_mm} * near_mm * std::int64_t{block_scans} < (std::int64_t{1} << 31));

template <class T>
RIG_AVX2 __m256i load(const T* from) {
  return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(from));
}
template <class T>
RIG_AVX2 void store(T* to, __m256i values) {
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(to), values);
}

/// Sums of 16 beams in 32 bits, in the order in which two vectors are unpacked.
struct Unpacked {
  __m256i low, high;

  /// Products of pairs, added up.
  RIG_AVX2 void add(const Unpacked& a, const Unpacked& b) {
    low = _mm256_add_epi32(low, _mm256_madd_epi16(a.low, b.low));
    high = _mm256_add_epi32(high, _mm256_madd_epi16(a.high, b.high));
  }
  RIG_AVX2 void add_to(std::int64_t* total) const {
    add_four(total, _mm256_castsi256_si128(low));
    add_four(total + 4, _mm256_castsi256_si128(high));
    add_four(total + 8, _mm256_extracti128_si256(low, 1));
    add_four(total + 12, _mm256_extracti128_si256(high, 1));
  }
  RIG_AVX2 static void add_four(std::int64_t* total, __m128i four) {
    store(total, _mm256_add_epi64(load(total), _mm256_cvtepi32_epi64(four)));
  }
};

RIG_AVX2 Unpacked paired(__m256i a, __m256i b) {
  return {_mm256_unpacklo_epi16(a, b), _mm256_unpackhi_epi16(a, b)};
}

/// 16 beams' ranges, the least and the greatest among them.
struct Extent {
  __m256i least, most;
  RIG_AVX2 void include(__m256i ranges, __m256i missing) {
    least = _mm256_min_epu16(least, _mm256_or_si256(ranges, missing));
    most = _mm256_max_epu16(most, ranges);
  }
  RIG_AVX2 bool within_reach_of(__m256i first) const {
    const __m256i far = _mm256_or_si256(_mm256_subs_epu16(most, first), _mm256_subs_epu16(first, least));
    const __m256i too_far = _mm256_subs_epu16(far, _mm256_set1_epi16(near_mm));
    return _mm256_testz_si256(too_far, too_far) != 0;
  }
};

/// 16 beams from k on; false, and nothing is added, when a range lies too far from the beam's first one.
[[gnu::target("avx2")]] bool add_near(const Block& block, std::size_t k) {
  const __m256i zero = _mm256_setzero_si256(), ones = _mm256_set1_epi16(1);
  const __m256i first = load(block.first + k), last = load(block.last + k);
  const __m256i never = _mm256_cmpeq_epi16(last, zero);
  Extent extent{_mm256_set1_epi16(-1), zero};
  extent.include(last, never);
  __m256i before = _mm256_andnot_si256(never, _mm256_sub_epi16(last, first)), missing_scans = zero;
  Unpacked sum{zero, zero}, square{zero, zero}, product{zero, zero};
  const std::uint16_t* row = block.rows + k;
  for (std::size_t pair = 0; pair < block_scans / 2; ++pair, row += 2 * block.beams) {
    __m256i now[2], previous[2];
    for (std::size_t i = 0; i < 2; ++i) {
      const __m256i ranges = load(row + i * block.beams);
      const __m256i missing = _mm256_cmpeq_epi16(ranges, zero);
      extent.include(ranges, missing);
      missing_scans = _mm256_add_epi16(missing_scans, missing);
      now[i] = _mm256_andnot_si256(missing, _mm256_sub_epi16(ranges, first));
      previous[i] = before;
      before = _mm256_or_si256(now[i], _mm256_and_si256(before, missing));
    }
    const Unpacked both = paired(now[0], now[1]);
    sum.add(both, {ones, ones});
    square.add(both, both);
    product.add(both, paired(previous[0], previous[1]));
  }
  if (!extent.within_reach_of(first)) return false;
  sum.add_to(block.sum + k);
  square.add_to(block.square + k);
  product.add_to(block.product + k);
  store(block.last + k, _mm256_add_epi16(first, before));
  const __m256i seen = _mm256_add_epi16(missing_scans, _mm256_set1_epi16(block_scans));
  std::uint32_t* const count = block.count + k;
  store(count, _mm256_add_epi32(load(count), _mm256_cvtepu16_epi32(_mm256_castsi256_si128(seen))));
  store(count + 8,
        _mm256_add_epi32(load(count + 8), _mm256_cvtepu16_epi32(_mm256_extracti128_si256(seen, 1))));
  return true;
}

void add_by_vectors(const Block& block) {
  for (std::size_t k = 0; k < block.beams; k += lanes)
    if (!add_near(block, k)) add_portably(block, k, k + lanes);
}
#endif

void add(const Block& block) {
#if defined(__x86_64__)
  static const bool vectors = __builtin_cpu_supports("avx2");
  if (vectors) return add_by_vectors(block);
#endif
  add_portably(block, 0, block.beams);
}

}  // namespace

BeamStatistics::BeamStatistics(std::size_t beams)
    : beams_(beams), row_((beams + lanes - 1) / lanes * lanes), block_(block_scans * row_) {
  first_.resize(row_);
  last_.resize(row_);
  count_.resize(row_);
  sum_.resize(row_);
  square_.resize(row_);
  product_.resize(row_);
}

void BeamStatistics::add(std::span<const std::uint16_t> range_mm) {
  ++scans_;
  const std::size_t size = std::min(beams_, range_mm.size());
  if (!all_begun_) {  // mostly they are after the first scan
    for (std::size_t k = 0; k < size; ++k)
      if (first_[k] == 0) first_[k] = range_mm[k];
    all_begun_ = std::find(first_.begin(), first_.begin() + static_cast<std::ptrdiff_t>(beams_), 0) ==
                 first_.begin() + static_cast<std::ptrdiff_t>(beams_);
  }
  std::uint16_t* const row = block_.data() + waiting_ * row_;
  std::copy_n(range_mm.begin(), size, row);
  std::fill(row + size, row + row_, std::uint16_t{0});
  if (++waiting_ < block_scans) return;
  fit::add({block_.data(), row_, first_.data(), last_.data(), count_.data(), sum_.data(), square_.data(),
            product_.data()});
  waiting_ = 0;
}

BeamStatistics::Sums BeamStatistics::sums(std::size_t k) const {
  Sums all{count_[k], sum_[k], square_[k], product_[k]};
  std::int64_t before = deviation(last_[k], first_[k]);
  for (std::size_t scan = 0; scan < waiting_; ++scan) {
    const std::uint16_t range = block_[scan * row_ + k];
    if (range == 0) continue;
    const std::int64_t now = deviation(range, first_[k]);
    ++all.count;
    all.sum += now;
    all.square += now * now;
    all.product += now * before;
    before = now;
  }
  return all;
}

double BeamStatistics::mean_mm(std::size_t k) const {
  const Sums all = sums(k);
  return first_[k] + static_cast<double>(all.sum) / static_cast<double>(all.count);
}

double BeamStatistics::variance_mm2(std::size_t k) const {
  const Sums all = sums(k);
  const auto n = static_cast<double>(all.count);
  const double mean = static_cast<double>(all.sum) / n;
  return std::max(0.0, (static_cast<double>(all.square) - n * mean * mean) / (n - 1));
}

double BeamStatistics::correlation(std::size_t k) const {
  const Sums all = sums(k);
  const double mean = static_cast<double>(all.sum) / static_cast<double>(all.count),
               variance = variance_mm2(k);
  const auto pairs = static_cast<double>(all.count - 1);
  return variance > 0 ? (static_cast<double>(all.product) / pairs - mean * mean) / variance : 0;
}

}  // namespace fit
