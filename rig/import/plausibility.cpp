// SPDX-License-Identifier: MIT
#include "rig/import/plausibility.hpp"

#include <algorithm>
#include <cmath>

#include "fit/angle.hpp"
#include "fit/number_format.hpp"

namespace rig {
namespace {

constexpr double least_rate_ratio = 0.7, most_rate_ratio = 1.4, most_distance_ratio = 3;
constexpr std::size_t scans_looked_ahead = 1000;

template <class T>
T middle_of(std::vector<T> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

void Plausibility::scan(const ImportedScan& scan) {
  if (scans_ == 0)
    first_ns_ = scan.stamp_ns;
  else
    interval_s_.push_back(static_cast<float>(1e-9 * static_cast<double>(scan.stamp_ns - last_ns_)));
  last_ns_ = scan.stamp_ns;
  ++scans_;
  const double swept_rad = std::abs(scan.geometry.step_rad) * static_cast<double>(scan.range_mm.size());
  if (scan.geometry.scan_s && *scan.geometry.scan_s > 0 && swept_rad > 0) {
    turn_s_sum_ += *scan.geometry.scan_s * 2 * fit::pi / swept_rad;
    ++timed_;
  }
  std::vector<std::uint16_t> ahead;
  for (std::size_t k = 0; k < scan.range_mm.size(); ++k) {
    if (scan.range_mm[k] == 0) continue;
    ++echoes_;
    const double angle = scan.geometry.first_rad + static_cast<double>(k) * scan.geometry.step_rad;
    if (std::abs(fit::wrap_angle(angle)) < 10 * fit::rad_per_deg) ahead.push_back(scan.range_mm[k]);
  }
  if (!ahead.empty() && ahead_mm_.size() < scans_looked_ahead)
    ahead_mm_.push_back(middle_of(std::move(ahead)));
}

std::optional<double> Plausibility::usual_interval_s() const {
  if (interval_s_.size() < 2) return std::nullopt;
  return middle_of(interval_s_);
}

std::optional<double> Plausibility::stamped_hz() const {
  const auto interval_s = usual_interval_s();
  if (!interval_s || *interval_s <= 0) return std::nullopt;
  return 1 / *interval_s;
}

std::vector<std::string> Plausibility::doubts(std::optional<double> true_mm) const {
  std::vector<std::string> doubts;
  if (scans_ > 0 && echoes_ == 0)
    doubts.push_back("Every range of its " + std::to_string(scans_) +
                     " scans is 0 (no echo): the unit may be another, or the columns. For a table, name unit "
                     "and columns with "
                     "--columns, e.g. --columns time_s,range_m*360.");
  if (scans_ > 2 && first_ns_ == last_ns_ && std::ranges::all_of(interval_s_, [](float s) { return s == 0; }))
    doubts.push_back("All its scans carry the same time, so motion cannot be reconstructed from them.");
  else if (const auto interval_s = usual_interval_s(); interval_s && timed_ > 0) {
    const double turn_s = turn_s_sum_ / static_cast<double>(timed_);
    // Stamps that come in bursts have the right mean, stamps with pauses the right middle.
    const double mean_s = 1e-9 * static_cast<double>(last_ns_ - first_ns_) / static_cast<double>(scans_ - 1);
    const auto contradicts = [&](double s) {
      return s < least_rate_ratio * turn_s || s > most_rate_ratio * turn_s;
    };
    if (contradicts(*interval_s) && contradicts(mean_s))
      doubts.push_back(
          "Its scans are stamped " + fit::format_fixed(1000 * *interval_s, 2) + " ms apart (" +
          fit::format_fixed(1 / std::max(1e-9, *interval_s), 2) + " Hz), but the lidar is said to turn in " +
          fit::format_fixed(1000 * turn_s, 2) + " ms (" + fit::format_fixed(1 / turn_s, 2) +
          " Hz): one of the two is wrong, or scans were left out. Give the lidar's rate with --scan-hz, "
          "or the unit of the times with --columns time_ms,...");
  }
  if (true_mm && !ahead_mm_.empty()) {
    const double seen_mm = middle_of(ahead_mm_), ratio = *true_mm / seen_mm;
    if (ratio > most_distance_ratio || ratio < 1 / most_distance_ratio)
      doubts.push_back(
          "The true distance is given as " + fit::format_fixed(*true_mm, 0) +
          " mm, but ahead of the lidar (0 deg) the ranges are about " + fit::format_fixed(seen_mm, 0) +
          " mm: one of the two is in another unit, or the target stands elsewhere. Check --true-mm, which "
          "takes millimetres, and the names of the files.");
  }
  return doubts;
}

}  // namespace rig
