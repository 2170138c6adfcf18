// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

#include "fit/recording.hpp"
#include "rig/fitting/deskew_reference.hpp"

namespace rig {

struct DeskewOptions {
  std::optional<double> offset_ms;  ///< Path time minus scan time; without it, it is estimated.
  std::optional<bool> reversed;     ///< Beams listed against their order in time; without it, judged.
  bool fuse = true;                 ///< Odometry with ICP; false: odometry alone.
  double odometry_u = 0.1;          ///< Relative standard uncertainty of odometry over one scan.
  int scans_per_capture = 0;        ///< The first so many of every capture; 0: all.
  /// The truth that scans taken in motion are judged against; without it, a stage's own captures at rest.
  std::shared_ptr<const DeskewReference> reference = nullptr;
};

/// The scans of a recording without their motion distortion: by odometry (or a stage's track) at each beam's
/// own time, and by its fusion with ICP (source B); and how much better they are for it.
class Deskewing {
 public:
  /// Computes everything. Throws MeasurementError, with the recording's name, if it has no scans or does not
  /// say how the lidar moved.
  Deskewing(const DeskewOptions& options, const fit::Recording& recording, const std::string& name);
  ~Deskewing();
  Deskewing(const Deskewing&) = delete;
  Deskewing& operator=(const Deskewing&) = delete;

  /// The result `deskew` (docs/method/moving.md), with pictures of the map.
  [[nodiscard]] nlohmann::json document() const;
  /// Replaces the track of a session by the fused one and adds the table `deskewed`.
  void write(const std::string& file) const;

 private:
  class Work;
  std::unique_ptr<Work> work_;
};

}  // namespace rig
