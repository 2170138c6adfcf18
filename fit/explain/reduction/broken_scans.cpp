// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/broken_scans.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
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

/// Beams at one end of a scan.
struct End {
  int scan = 0, first = 0, step = 1, beams = 0;
};

/// Where nothing came back from there on, though so much was lost by no chance; none where nothing at all
/// did.
std::optional<End> break_at(const Samples& samples, const std::vector<double>& surprise, int scan, int first,
                            int step) {
  End end{scan, first, step, 0};
  double sum = 0;
  for (int beam = first; !is_echo(samples.at(scan, beam)); beam += step) {
    if (++end.beams == samples.beams) return {};
    if (samples.at(scan, beam) >= 0) sum += surprise[static_cast<std::size_t>(beam)];
  }
  if (sum < impossible) return {};
  return end;
}

/// Whether scans, one after the other, end at the same beam: a driver that was stopped or changed does that,
/// and nothing that stands before the lidar, which has no such edge.
bool is_one_cut(const std::vector<End>& breaks) {
  const End &first = breaks.front(), &last = breaks.back();
  return std::cmp_equal(last.scan - first.scan + 1, breaks.size()) &&
         std::ranges::all_of(
             breaks, [&](const End& end) { return end.first == first.first && end.beams == first.beams; });
}

}  // namespace

int do_not_look_beyond_breaks(Samples& samples) {
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
  std::vector<End> breaks;
  for (int scan = 0; scan < samples.scans; ++scan)
    for (const auto& [first, step] : {std::pair(0, 1), std::pair(samples.beams - 1, -1)})
      if (const auto end = break_at(samples, surprise, scan, first, step)) breaks.push_back(*end);
  if (static_cast<double>(breaks.size()) > rarely * samples.scans && !is_one_cut(breaks)) return 0;
  for (const End& end : breaks)
    for (int k = 0; k < end.beams; ++k)
      samples.range[samples.index(end.scan, end.first + k * end.step)] = not_looked;
  return static_cast<int>(breaks.size());
}

}  // namespace fit::explain::reduction
