// SPDX-License-Identifier: MIT
#pragma once

#include <set>
#include <string>
#include <vector>

#include "fit/explain/scene/angle_grid.hpp"
#include "fit/recording.hpp"

namespace fit::explain {

/// How far a recording's lidar was carried, from its poses.
struct Carried {
  double path_mm = 0, turned_rad = 0;
  std::size_t poses = 0;
  [[nodiscard]] bool moved() const { return path_mm > 50 || turned_rad > 3 * rad_per_deg; }
};
[[nodiscard]] Carried carried(const Recording& recording);

/// A recording whose bench knows no targets, before the flat walls that its own scans show: every standstill
/// at rest is a capture of its own with its own walls; scans while the lidar was carried are left out. Walls
/// that were fitted to the recording take up what bends all of it alike: noise, echoes and memory remain to
/// be explained, and what differs along a wall.
class FittedRoom : public Recording {
 public:
  /// Throws std::invalid_argument when nothing stands still long enough or no wall is seen.
  explicit FittedRoom(const Recording& own);

  [[nodiscard]] const Bench& bench() const override { return bench_; }
  [[nodiscard]] const std::vector<CaptureInfo>& captures() const override { return captures_; }
  void for_each_scan(std::size_t index, const std::function<void(const ScanView&)>& visit) const override;
  [[nodiscard]] const std::vector<TrackPose>& track() const override { return nothing_; }
  /// Walls that are not there, for every capture: those of other stretches.
  [[nodiscard]] const std::vector<std::set<std::string>>& absent() const { return absent_; }
  [[nodiscard]] std::string note() const;

 private:
  struct Standstill {
    std::size_t capture = 0;
    std::int64_t first_us = 0, last_us = 0;
    int scans = 0;
  };
  [[nodiscard]] std::vector<Standstill> standstills() const;
  /// By direction, all round.
  struct Ranges {
    explicit Ranges(const AngleGrid& of) : grid(of), list(of.count()) {}
    AngleGrid grid;
    std::vector<std::vector<float>> list;
  };
  [[nodiscard]] Ranges ranges_of(const Standstill& standstill) const;
  [[nodiscard]] std::vector<Target> walls_of(const Standstill& standstill) const;
  void walk(const Standstill& standstill, const std::function<void(const ScanView&)>& visit) const;

  const Recording& own_;
  Bench bench_;
  std::vector<Standstill> standstills_;
  std::vector<CaptureInfo> captures_;
  std::vector<std::set<std::string>> absent_;
  std::vector<TrackPose> nothing_;
  bool moved_ = false;
};

}  // namespace fit::explain
