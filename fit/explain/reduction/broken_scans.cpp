// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/broken_scans.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace fit::explain::reduction {
namespace {

constexpr double impossible = 30;  // minus the logarithm of a probability

}  // namespace

bool RepeatedScans::is_again(const ScanView& scan) {
  if (range_mm_.size() == scan.range_mm.size()) {
    double alike = 0, seen = 0;  // beams with an echo: silence is always alike
    for (std::size_t k = 0; k < range_mm_.size(); ++k) {
      if (!is_echo(range_mm_[k]) && !is_echo(scan.range_mm[k])) continue;
      ++seen;
      alike += range_mm_[k] == scan.range_mm[k];
    }
    if (alike == seen && std::ranges::equal(range_mm_, scan.range_mm) &&
        std::ranges::equal(intensity_, scan.intensity)) {
      const double by_chance = compared_ > 0 ? (alike_ + 1) / (compared_ + 1) : 1;
      return -seen * std::log(by_chance) > impossible;
    }
    alike_ += alike;
    compared_ += seen;
  }
  range_mm_.assign(scan.range_mm.begin(), scan.range_mm.end());
  intensity_.assign(scan.intensity.begin(), scan.intensity.end());
  return false;
}

namespace {

/// Neighbouring beams of one scan from which nothing came back.
struct Gap {
  int scan = 0, first = 0, end = 0;
};

/// Those of a scan where so much was lost by no chance; none where nothing at all came back.
std::vector<Gap> gaps_of(const Samples& samples, const std::vector<double>& surprise, int scan) {
  std::vector<Gap> gaps;
  for (int first = 0; first < samples.beams; ++first) {
    Gap gap{scan, first, first};
    double sum = 0;
    for (; gap.end < samples.beams && !is_echo(samples.at(scan, gap.end)); ++gap.end)
      if (samples.at(scan, gap.end) >= 0) sum += surprise[static_cast<std::size_t>(gap.end)];
    if (sum >= impossible && gap.end - gap.first < samples.beams) gaps.push_back(gap);
    first = gap.end;
  }
  return gaps;
}

/// Whether scans, one after the other, end at the same beam: a driver that was stopped or changed does that,
/// and nothing that stands before the lidar, which has no such edge.
bool is_one_cut(const std::vector<Gap>& gaps, int beams) {
  const Gap &first = gaps.front(), &last = gaps.back();
  return (first.first == 0 || first.end == beams) &&
         std::cmp_equal(last.scan - first.scan + 1, gaps.size()) &&
         std::ranges::all_of(
             gaps, [&](const Gap& gap) { return gap.first == first.first && gap.end == first.end; });
}

}  // namespace

int do_not_look_at_gaps(Samples& samples) {
  constexpr int fewest_scans = 5;
  constexpr double rarely = 0.2;  // of the scans: what happens more often is something before the lidar
  if (samples.scans < fewest_scans || samples.beams == 0) return 0;
  std::vector<double> surprise;  // of a loss, at most what so few scans say
  for (int beam = 0; beam < samples.beams; ++beam) {
    double looks = 0, echoes = 0;
    for (int scan = 0; scan < samples.scans; ++scan) {
      looks += samples.at(scan, beam) >= 0;
      echoes += is_echo(samples.at(scan, beam));
    }
    surprise.push_back(std::log((looks + 1) / (looks + 1 - echoes)));
  }
  std::vector<Gap> gaps;
  int broken = 0;
  for (int scan = 0; scan < samples.scans; ++scan) {
    const std::vector<Gap> own = gaps_of(samples, surprise, scan);
    gaps.insert(gaps.end(), own.begin(), own.end());
    broken += !own.empty();
  }
  if (broken > rarely * samples.scans && !is_one_cut(gaps, samples.beams)) return 0;
  for (const Gap& gap : gaps)
    for (int beam = gap.first; beam < gap.end; ++beam)
      samples.range[samples.index(gap.scan, beam)] = not_looked;
  return broken;
}

}  // namespace fit::explain::reduction
