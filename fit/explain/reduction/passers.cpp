// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/passers.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>
#include <vector>

namespace fit::explain::reduction {
namespace {

constexpr int fewest_beams = 5;   // side by side: less may be dust, or an edge
constexpr double rough_mm = 150;  // one thing: no farther apart than this are neighbours

/// Where a scan's beams meet something before their targets: first beam and the one behind the last.
std::vector<std::pair<int, int>> things_before(const Samples& samples, int scan,
                                               const std::vector<double>& targets_mm) {
  const auto is_before = [&](int beam) {
    const double range_mm = samples.at(scan, beam);
    return is_echo(range_mm) && range_mm < targets_mm[static_cast<std::size_t>(beam)] - astray_mm;
  };
  std::vector<std::pair<int, int>> things;
  for (int first = 0, end = 0; first < samples.beams; first = std::max(end, first + 1)) {
    for (end = first; end < samples.beams && is_before(end); ++end)
      if (end > first && std::abs(samples.at(scan, end) - samples.at(scan, end - 1)) > rough_mm) break;
    if (end - first >= fewest_beams) things.emplace_back(first, end);
  }
  return things;
}

}  // namespace

std::optional<Passer> leave_out_passers(Samples& samples, const Scene& scene, double stage_rad) {
  if (samples.scans < 2) return {};
  std::vector<double> targets_mm;
  for (const double beam_rad : samples.beam_rad) {
    const Sight sight = scene.look(stage_rad, beam_rad);
    targets_mm.push_back(sight.target < 0 ? 0 : sight.range_mm);
  }
  std::vector<std::vector<int>> scans_of_beam(targets_mm.size());
  for (int scan = 0; scan < samples.scans; ++scan)
    for (const auto& [first, end] : things_before(samples, scan, targets_mm))
      for (int beam = first; beam < end; ++beam)
        scans_of_beam[static_cast<std::size_t>(beam)].push_back(scan);
  std::optional<Passer> passer;
  std::set<int> in_scans;
  for (int beam = 0; beam < samples.beams; ++beam) {
    const std::vector<int>& scans = scans_of_beam[static_cast<std::size_t>(beam)];
    if (scans.empty() || std::ssize(scans) == samples.scans) continue;
    const double beam_rad = samples.beam_rad[static_cast<std::size_t>(beam)];
    if (!passer) passer.emplace(Passer{.from_rad = beam_rad});
    passer->to_rad = beam_rad;
    for (const int scan : scans) {
      samples.range[samples.index(scan, beam)] = not_looked;
      in_scans.insert(scan);
    }
  }
  if (passer) passer->scans = static_cast<int>(in_scans.size());
  return passer;
}

}  // namespace fit::explain::reduction
