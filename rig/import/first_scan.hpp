// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "rig/import/importer.hpp"

namespace rig {

/// Reads a file's beginning: when it starts, and what its scans are like.
class FirstScan : public ImportSink {
 public:
  void scan(const ImportedScan& scan) override {
    if (found_) return;
    found_ = true;
    stamp_ns_ = std::min(stamp_ns_, scan.stamp_ns);
    geometry_ = scan.geometry;
    beams_ = scan.range_mm.size();
    frame_ = scan.frame;
  }
  void pose(std::int64_t stamp_ns, const std::string&, const std::string&,
            const fit::TrackPose& pose) override {
    poses_ = true;
    wheels_ = wheels_ || pose.wheel_left_rad;
    first_pose_ns_ = std::min(first_pose_ns_, stamp_ns);
  }
  void imu(std::int64_t, const std::string&, double, double) override {}
  void transform(const ImportedTransform&) override {}
  void property(const std::string&, const std::string&) override {}
  void note(const std::string& text) override { notes_.push_back(text); }
  bool wants_more() const override { return !found_; }

  [[nodiscard]] bool found() const { return found_; }
  [[nodiscard]] bool has_poses() const { return poses_; }
  [[nodiscard]] bool has_wheels() const { return wheels_; }
  [[nodiscard]] std::int64_t stamp_ns() const { return stamp_ns_; }
  [[nodiscard]] std::int64_t first_pose_ns() const { return first_pose_ns_; }
  [[nodiscard]] std::size_t beams() const { return beams_; }
  [[nodiscard]] const fit::ScanGeometry& geometry() const { return geometry_; }
  [[nodiscard]] const std::string& frame() const { return frame_; }
  [[nodiscard]] const std::vector<std::string>& notes() const { return notes_; }

 private:
  bool found_ = false, poses_ = false, wheels_ = false;
  std::int64_t stamp_ns_ = std::numeric_limits<std::int64_t>::max(),
               first_pose_ns_ = std::numeric_limits<std::int64_t>::max();
  std::size_t beams_ = 0;
  fit::ScanGeometry geometry_;
  std::string frame_;
  std::vector<std::string> notes_;
};

}  // namespace rig
