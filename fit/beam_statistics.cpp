// SPDX-License-Identifier: MIT
#include "fit/beam_statistics.hpp"

#include <algorithm>

namespace fit {
namespace {

struct Sums {
  std::uint32_t *count, *last;
  std::uint64_t *sum, *square, *product;
};

/// Plain loops without branches over plain arrays: compilers make vectors of them, of any width.
[[gnu::always_inline]] inline void add_scan(const Sums& sums, const std::uint16_t* __restrict x,
                                            std::size_t size) {
  std::uint32_t* __restrict count = sums.count;
  std::uint32_t* __restrict last = sums.last;
  std::uint64_t* __restrict sum = sums.sum;
  std::uint64_t* __restrict square = sums.square;
  std::uint64_t* __restrict product = sums.product;
  for (std::size_t k = 0; k < size; ++k) {
    const std::uint32_t now = x[k];
    sum[k] += now;
    square[k] += std::uint64_t{now} * now;
    product[k] += std::uint64_t{now} * last[k];
  }
  for (std::size_t k = 0; k < size; ++k) {
    const std::uint32_t now = x[k];
    const std::uint32_t seen = now != 0 ? ~0u : 0u;
    count[k] -= seen;
    last[k] = (now & seen) | (last[k] & ~seen);
  }
}

using AddScan = void (*)(const Sums&, const std::uint16_t*, std::size_t);

void add_scan_portably(const Sums& sums, const std::uint16_t* x, std::size_t size) {
  add_scan(sums, x, size);
}

#if defined(__x86_64__)
[[gnu::target("avx2")]] void add_scan_avx2(const Sums& sums, const std::uint16_t* x, std::size_t size) {
  add_scan(sums, x, size);
}
AddScan fastest() { return __builtin_cpu_supports("avx2") ? add_scan_avx2 : add_scan_portably; }
#else
AddScan fastest() { return add_scan_portably; }
#endif

}  // namespace

BeamStatistics::BeamStatistics(std::size_t beams)
    : count_(beams), first_(beams), last_(beams), sum_(beams), square_(beams), product_(beams) {}

void BeamStatistics::add(std::span<const std::uint16_t> range_mm) {
  static const AddScan add_one = fastest();
  ++scans_;
  const std::size_t size = std::min(count_.size(), range_mm.size());
  if (!all_begun_) {  // mostly they are after the first scan
    for (std::size_t k = 0; k < size; ++k)
      if (first_[k] == 0) first_[k] = range_mm[k];
    all_begun_ = std::ranges::find(first_, 0u) == first_.end();
  }
  add_one({count_.data(), last_.data(), sum_.data(), square_.data(), product_.data()}, range_mm.data(), size);
}

double BeamStatistics::sum_about_first(std::size_t k) const {
  return static_cast<double>(static_cast<std::int64_t>(sum_[k]) - std::int64_t{first_[k]} * count_[k]);
}

double BeamStatistics::mean_mm(std::size_t k) const {
  return first_[k] + sum_about_first(k) / static_cast<double>(count_[k]);
}

double BeamStatistics::variance_mm2(std::size_t k) const {
  const std::int64_t first = first_[k], n = count_[k], sum = static_cast<std::int64_t>(sum_[k]);
  const auto square =
      static_cast<double>(static_cast<std::int64_t>(square_[k]) - 2 * first * sum + n * first * first);
  const double mean = sum_about_first(k) / static_cast<double>(n);
  return std::max(0.0, (square - static_cast<double>(n) * mean * mean) / static_cast<double>(n - 1));
}

double BeamStatistics::correlation(std::size_t k) const {
  const std::int64_t first = first_[k], last = last_[k], pairs = std::int64_t{count_[k]} - 1,
                     sum = static_cast<std::int64_t>(sum_[k]);
  const auto product = static_cast<double>(static_cast<std::int64_t>(product_[k]) -
                                           first * (2 * sum - first - last) + pairs * first * first);
  const double mean = sum_about_first(k) / static_cast<double>(count_[k]), variance = variance_mm2(k);
  return variance > 0 ? (product / static_cast<double>(pairs) - mean * mean) / variance : 0;
}

}  // namespace fit
