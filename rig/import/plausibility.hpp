// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "rig/import/importer.hpp"

namespace rig {

/// Watches what one file gives and says what in it cannot be: a wrong unit or a wrong rate would else become
/// a wrong calibration.
class Plausibility {
 public:
  void scan(const ImportedScan& scan);
  void pose(std::int64_t stamp_ns, const fit::TrackPose& pose);
  /// Of a fan that no lidar has, in a sentence with what to do; nothing where there is none.
  [[nodiscard]] std::optional<std::string> impossible() const;
  /// Sentences with what to do; empty when all is plausible. `true_mm`: the distance that the operator gives
  /// for a target ahead of the lidar.
  [[nodiscard]] std::vector<std::string> doubts(std::optional<double> true_mm) const;
  /// Sentences on what may well be, and should be known.
  [[nodiscard]] std::vector<std::string> notes() const;
  /// How often scans were taken, by their stamps; nothing for fewer than three scans, and for a rate that no
  /// lidar has.
  [[nodiscard]] std::optional<double> stamped_hz() const;

 private:
  /// A way over time, window by window of a second: stamps that come in bursts do not change it.
  class Speed {
   public:
    void add(std::int64_t stamp_ns, double way);
    /// Exceeded in a tenth of the windows in which something moved.
    [[nodiscard]] double high() const;

   private:
    std::optional<std::int64_t> since_ns_;
    double way_ = 0;
    float unfinished_ = 0;  ///< Of the window that has not ended.
    std::vector<float> windows_;
  };

  [[nodiscard]] std::optional<double> usual_interval_s() const;
  [[nodiscard]] std::string scans_where(const std::function<bool(float)>& interval_is,
                                        const std::string& what, const std::string& by) const;
  void doubt_times(std::vector<std::string>& doubts) const;
  void doubt_angles(std::vector<std::string>& doubts) const;
  void doubt_speeds(std::vector<std::string>& doubts) const;

  std::uint64_t scans_ = 0, echoes_ = 0, timed_ = 0;
  std::int64_t first_ns_ = 0, last_ns_ = 0;
  double turn_s_sum_ = 0;
  std::vector<float> interval_s_;
  std::vector<std::uint16_t> ahead_mm_;  ///< Middle range within 10 deg of the x axis, scan by scan.
  double widest_fan_rad_ = 0, widest_step_rad_ = 0;
  std::size_t widest_beams_ = 0;
  std::optional<std::int64_t> last_track_ns_;
  std::vector<float> track_interval_s_;
  std::optional<fit::TrackPose> last_pose_, last_wheels_;
  Speed travel_, turn_, wheels_;
};

}  // namespace rig
