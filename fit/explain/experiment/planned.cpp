// SPDX-License-Identifier: MIT
#include "fit/explain/experiment/planned.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>

#include "fit/explain/scene/scene.hpp"

namespace fit::explain {

void Planned::for_each_scan(std::size_t index, const std::function<void(const ScanView&)>& visit) const {
  constexpr double nearest_mm = 30, farthest_mm = 60000, most_counts = 60000;
  const CaptureInfo& info = captures_[index];
  const Scene scene(bench_, Nuisance(bench_), info);
  const auto beams = static_cast<std::size_t>(info.beams());
  std::vector<double> expected_mm(beams, 0.0);
  std::vector<std::uint16_t> range(beams, 0), intensity(beams, 0);
  for (std::size_t b = 0; b < beams; ++b) {
    const Sight sight =
        scene.look(info.stage_rad, bench_.lidar.beam_angle(info.step_of(static_cast<int>(b))));
    if (sight.target < 0) continue;
    expected_mm[b] = sight.range_mm;
    const double reflectance = reflectance_in(info, bench_.target_at(sight.target));
    intensity[b] = static_cast<std::uint16_t>(
        std::clamp(law_.counts(reflectance, sight.cos_incidence(), sight.range_mm), 1.0, most_counts));
  }
  std::mt19937 random(static_cast<unsigned>(index) + 1);
  std::normal_distribution<double> noise;
  ScanView view;
  view.range_mm = range;
  view.intensity = intensity;
  for (view.seq = 0; view.seq < scans_; ++view.seq) {
    for (std::size_t b = 0; b < beams; ++b)
      if (expected_mm[b] > 0)
        range[b] = static_cast<std::uint16_t>(
            std::clamp(std::round(expected_mm[b] + sigma_mm_ * noise(random)), nearest_mm, farthest_mm));
    view.host_us = info.started_us +
                   static_cast<std::int64_t>(static_cast<double>(view.seq) * 1e6 / bench_.lidar.scan_hz);
    visit(view);
  }
}

}  // namespace fit::explain
