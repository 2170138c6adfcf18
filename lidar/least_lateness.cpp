// SPDX-License-Identifier: MIT
#include "lidar/least_lateness.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace lidar {
namespace {

constexpr double alone = 6;  // steps between neighbours; one is usual

LeastLateness densest(std::vector<Lateness>& scans) {
  std::sort(scans.begin(), scans.end(), [](const Lateness& a, const Lateness& b) { return a.us < b.us; });
  const std::size_t count = scans.size(), quarter = std::max<std::size_t>(4, count / 4);
  if (count < 8) return {scans[0].us, 1000 / std::sqrt(12.0), scans[0].device_ms, 0};
  std::size_t first = 0;
  for (std::size_t i = 1; i + quarter < count; ++i)
    if (scans[i + quarter].us - scans[i].us < scans[first + quarter].us - scans[first].us) first = i;
  // The shortest interval that holds half of them: what some scans are late by does not matter.
  double half_us = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i + count / 2 < count; ++i)
    half_us = std::min(half_us, scans[i + count / 2].us - scans[i].us);
  const double excess = half_us / std::log(2.0);
  const double step = std::max(excess / static_cast<double>(count),
                               (scans[first + quarter].us - scans[first].us) / static_cast<double>(quarter));
  while (first > 0 && scans[first].us - scans[first - 1].us < alone * step + least_u_lateness_us) --first;
  const double spread = std::max(1.5 * step, scans[first + 2].us - scans[first].us);
  const double u = std::hypot(std::max(spread, least_u_lateness_us), 1000 * scans[first].u_start_ms);
  return {scans[first].us - step, u, scans[first].device_ms, excess};
}

}  // namespace

LeastLateness least_of(std::vector<Lateness>& scans) {
  LeastLateness least = densest(scans);
  const std::size_t third = scans.size() / 3;
  if (third < 8) return least;
  std::sort(scans.begin(), scans.end(),
            [](const Lateness& a, const Lateness& b) { return a.device_ms < b.device_ms; });
  double sum = 0, squares = 0;
  for (std::size_t part = 0; part < 3; ++part) {
    std::vector<Lateness> of_part(scans.begin() + static_cast<std::ptrdiff_t>(part * third),
                                  scans.begin() + static_cast<std::ptrdiff_t>((part + 1) * third));
    const double off_us = densest(of_part).us - least.us;
    sum += off_us;
    squares += off_us * off_us;
  }
  least.u_us = std::hypot(least.u_us, std::sqrt(std::max(0.0, squares - sum * sum / 3) / 2));
  return least;
}

}  // namespace lidar
