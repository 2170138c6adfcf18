// SPDX-License-Identifier: MIT
#include "rig/import/beam_grid.hpp"

#include <algorithm>
#include <cmath>

#include "fit/numeric/angle.hpp"

namespace rig {
namespace {

constexpr double most_directions = 100'000;

/// Angles without jumps of a turn.
std::vector<double> unwrapped(std::span<const double> angle_rad) {
  std::vector<double> out(angle_rad.begin(), angle_rad.end());
  for (std::size_t i = 1; i < out.size(); ++i)
    out[i] = out[i - 1] + fit::wrap_angle(angle_rad[i] - angle_rad[i - 1]);
  return out;
}

/// The usual difference between neighbours; 0 where they have no common direction.
double usual_step(const std::vector<double>& angles) {
  std::vector<double> differences;
  std::size_t growing = 0;
  for (std::size_t i = 1; i < angles.size(); ++i) {
    const double difference = angles[i] - angles[i - 1];
    if (difference == 0) continue;
    differences.push_back(std::abs(difference));
    growing += difference > 0 ? 1 : 0;
  }
  if (differences.empty()) return 0;
  const double share = static_cast<double>(growing) / static_cast<double>(differences.size());
  if (share > 0.1 && share < 0.9) return 0;
  const auto middle = differences.begin() + static_cast<std::ptrdiff_t>(differences.size() / 2);
  std::nth_element(differences.begin(), middle, differences.end());
  return share > 0.5 ? *middle : -*middle;
}

/// Least squares of the angles over their places.
void fit_line(const std::vector<double>& angles, const std::vector<double>& places, double& first,
              double& step) {
  const auto n = static_cast<double>(angles.size());
  double mean_angle = 0, mean_place = 0, products = 0, squares = 0;
  for (std::size_t i = 0; i < angles.size(); ++i) mean_angle += angles[i] / n, mean_place += places[i] / n;
  for (std::size_t i = 0; i < angles.size(); ++i) {
    products += (places[i] - mean_place) * (angles[i] - mean_angle);
    squares += (places[i] - mean_place) * (places[i] - mean_place);
  }
  if (squares > 0) step = products / squares;
  first = mean_angle - step * mean_place;
}

}  // namespace

std::optional<BeamGrid> beam_grid(std::span<const double> angle_rad,
                                  const std::optional<fit::ScanGeometry>& known) {
  if (angle_rad.size() < 2 || !std::ranges::all_of(angle_rad, [](double a) { return std::abs(a) < 100; }))
    return std::nullopt;
  std::vector<double> angles = unwrapped(angle_rad), places(angles.size(), 0);
  BeamGrid grid;
  if (known) {
    grid.geometry = *known;
    const double turns = (angles[0] - known->first_rad) / (2 * fit::pi);
    const double whole =
        2 * fit::pi * (known->step_rad > 0 ? std::floor(turns + 1e-6) : std::ceil(turns - 1e-6));
    for (double& angle : angles) angle -= whole;
  } else {
    double step = usual_step(angles), first = angles[0];
    if (step == 0 || std::abs(angles.back() - angles[0]) > most_directions * std::abs(step))
      return std::nullopt;
    for (std::size_t i = 1; i < angles.size(); ++i)
      places[i] = places[i - 1] + std::max(0.0, std::round((angles[i] - angles[i - 1]) / step));
    // Rounded to the millimetre, near points wander by more than a step: the line through all tells better.
    for (int round = 0; round < 3; ++round) {
      fit_line(angles, places, first, step);
      if (step == 0 || !std::isfinite(step)) return std::nullopt;
      for (std::size_t i = 0; i < angles.size(); ++i) places[i] = std::round((angles[i] - first) / step);
    }
    const double least = *std::ranges::min_element(places);
    grid.geometry.first_rad = first + least * step;
    grid.geometry.step_rad = step;
  }
  for (const double angle : angles) {
    const double place = std::round((angle - grid.geometry.first_rad) / grid.geometry.step_rad);
    if (!(place >= 0 && place < most_directions)) return std::nullopt;
    const auto k = static_cast<std::size_t>(place);
    grid.farthest_rad = std::max(grid.farthest_rad,
                                 std::abs(angle - grid.geometry.first_rad - place * grid.geometry.step_rad));
    grid.place.push_back(k);
    grid.beams = std::max(grid.beams, k + 1);
  }
  std::vector<bool> taken(grid.beams, false);
  for (const std::size_t k : grid.place) {
    grid.doubled += taken[k] ? 1 : 0;
    taken[k] = true;
  }
  return grid;
}

}  // namespace rig
