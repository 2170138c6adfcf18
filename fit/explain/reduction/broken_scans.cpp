// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/broken_scans.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace fit::explain::reduction {
namespace {

constexpr double impossible = 30;  // minus the logarithm of a probability

}  // namespace

bool RepeatedScans::is_again(const ScanView& scan) {
  if (range_mm_.size() == scan.range_mm.size()) {
    double alike = 0;
    for (std::size_t k = 0; k < range_mm_.size(); ++k) alike += range_mm_[k] == scan.range_mm[k];
    const auto beams = static_cast<double>(range_mm_.size());
    if (alike == beams && std::ranges::equal(intensity_, scan.intensity)) {
      const double by_chance = compared_ > 0 ? (alike_ + 1) / (compared_ + 1) : 1;
      return -beams * std::log(by_chance) > impossible;
    }
    alike_ += alike;
    compared_ += beams;
  }
  range_mm_.assign(scan.range_mm.begin(), scan.range_mm.end());
  intensity_.assign(scan.intensity.begin(), scan.intensity.end());
  return false;
}

int do_not_look_beyond_breaks(Samples& samples) {
  constexpr int fewest_scans = 5;
  if (samples.scans < fewest_scans) return 0;
  std::vector<double> echoes(static_cast<std::size_t>(samples.beams), 0.0);
  for (int scan = 0; scan < samples.scans; ++scan)
    for (int beam = 0; beam < samples.beams; ++beam)
      echoes[static_cast<std::size_t>(beam)] += is_echo(samples.at(scan, beam));
  std::vector<double> surprise;  // of a loss, at most what so few scans say
  for (const double count : echoes)
    surprise.push_back(std::log((samples.scans + 1) / (samples.scans + 1 - count)));
  int broken = 0;
  for (int scan = 0; scan < samples.scans; ++scan) {
    const auto run = [&](int first, int step) {
      int end = first;
      double sum = 0;
      for (; end >= 0 && end < samples.beams && !is_echo(samples.at(scan, end)); end += step)
        sum += surprise[static_cast<std::size_t>(end)];
      if (sum < impossible) return false;
      for (int beam = first; beam != end; beam += step) samples.range[samples.index(scan, beam)] = not_looked;
      return true;
    };
    const bool at_begin = run(0, 1), at_end = run(samples.beams - 1, -1);
    broken += at_begin || at_end;
  }
  return broken;
}

}  // namespace fit::explain::reduction
