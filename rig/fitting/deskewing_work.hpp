// SPDX-License-Identifier: MIT
#pragma once
// What a deskewing computes (deskewing.cpp) and says of it (deskewing_result.cpp). For these two only.

#include <Eigen/Core>
#include <cmath>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "fit/motion/deskew.hpp"
#include "fit/motion/map_fusion.hpp"
#include "fit/motion/shape_at_rest.hpp"
#include "fit/motion/sweep_timing.hpp"
#include "rig/fitting/deskewing.hpp"

namespace rig {
namespace deskew_parts {

using Points = std::vector<Eigen::Vector2d>;

/// A scan with what is needed to write it again.
struct ScanOfSession {
  std::int64_t capture = 0, seq = 0, host_us = 0;
  double stage_rate_deg_s = 0;
  bool turning = false;
  std::size_t beams = 0;
  fit::Sweep sweep;
};

/// One way to place and correct the scans of a session.
struct Way {
  std::string name, label;
  Points map;           ///< All points of all scans in the map.
  double local_mm = 0;  ///< Mean thickness within windows of some scans: no drift, only distortion.
  fit::Crispness crispness;

  /// Judges windows of 20 scans, then the whole.
  void judge(const std::vector<std::size_t>& scan_ends) {
    double sum = 0;
    int windows = 0;
    constexpr std::size_t length = 20;
    for (std::size_t first = 0; first + length <= scan_ends.size(); first += length) {
      const std::size_t from = first == 0 ? 0 : scan_ends[first - 1], to = scan_ends[first + length - 1];
      const auto window = fit::crispness({map.data() + from, to - from}, 150, 400);
      if (window.judged < 20) continue;
      sum += window.mean_thickness_mm;
      ++windows;
    }
    local_mm = windows > 0 ? sum / windows : std::nan("");
    crispness = fit::crispness(map);
  }
};

/// How far one scan's points are from the reference, rms in mm, by each way of correcting it; NaN: not
/// judged.
struct Distances {
  double before = std::nan(""), by_path = std::nan(""), fused = std::nan("");
};

/// How far scans at one stage rate depart from the scene as seen at rest, mm, one value a scan.
struct Departures {
  std::vector<double> before, by_stage, fused;
};

std::vector<ScanOfSession> read_scans(const fit::Recording& recording, int most_per_capture);

}  // namespace deskew_parts

/// Everything between reading and writing.
class Deskewing::Work {
 public:
  using Departures = deskew_parts::Departures;
  using Distances = deskew_parts::Distances;
  using Points = deskew_parts::Points;
  using ScanOfSession = deskew_parts::ScanOfSession;
  using Way = deskew_parts::Way;

  Work(const DeskewOptions& options, const fit::Recording& recording, const std::string& name);
  void run();

  [[nodiscard]] nlohmann::json document() const;
  void write(const std::string& file) const;

 private:
  void find_timing();
  void by_odometry();
  void by_fusion();
  [[nodiscard]] double path_begin(const fit::Sweep& sweep) const { return sweep.begin_s + timing_.offset_s; }
  void find_shape_at_rest();
  [[nodiscard]] bool moving(const fit::Sweep& sweep) const;
  [[nodiscard]] std::vector<fit::ShapeAtRest::Scan> standing_about(const fit::Pose2& pose) const;
  void read_reference(const fit::Recording& reference);
  void add_reference(nlohmann::json& out) const;
  void compare_with_rest(std::size_t scan, std::vector<double> Departures::*way, double Distances::*distance,
                         const Points& points);
  [[nodiscard]] std::string speeds_in_words() const;
  void add_crispness(nlohmann::json& out) const;
  void add_timing(nlohmann::json& out) const;
  void add_shapes(nlohmann::json& out) const;
  void add_plots(nlohmann::json& out) const;
  void add_notes(nlohmann::json& out) const;

  DeskewOptions options_;
  fit::Carrier carrier_;
  const fit::Path& path_;
  fit::Pose2 lidar_;
  std::vector<ScanOfSession> scans_;
  fit::SweepTiming timing_;
  fit::TimingEstimate estimate_;
  std::vector<Way> ways_;
  std::vector<std::size_t> ends_;
  std::size_t count_ = 0, matched_ = 0;
  std::vector<fit::Pose2> begins_;           ///< Of the lidar in the map.
  std::vector<fit::TimedPose> fused_path_;   ///< Of the carrier.
  std::vector<Points> corrected_;            ///< Each scan's points in the lidar's frame at its beginning.
  fit::ShapeAtRest at_rest_;                 ///< Of what a stage turned; else empty.
  std::map<double, Departures> departures_;  ///< By stage rate, deg/s.
  std::vector<Distances> distances_;         ///< By scan.
  double fusion_ms_ = 0, weakest_ = 1, sharpest_turn_rad_ = 0, longest_way_mm_ = 0;
};

}  // namespace rig
