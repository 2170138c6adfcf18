// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <vector>

#include "fit/bench/radiometer.hpp"
#include "fit/recording.hpp"

namespace fit::explain {

/// Captures that are not made yet, as geometry alone says them: ranges with noise of `sigma_mm`, intensities
/// by the law. Keeps references to the bench and to the captures.
class Planned final : public Recording {
 public:
  Planned(const Bench& bench, const std::vector<CaptureInfo>& captures, const IntensityLaw& law, int scans,
          double sigma_mm)
      : bench_(bench), captures_(captures), law_(law), scans_(scans), sigma_mm_(sigma_mm) {}
  [[nodiscard]] const Bench& bench() const override { return bench_; }
  [[nodiscard]] const std::vector<CaptureInfo>& captures() const override { return captures_; }
  [[nodiscard]] const std::vector<TrackPose>& track() const override { return track_; }
  void for_each_scan(std::size_t index, const std::function<void(const ScanView&)>& visit) const override;

 private:
  const Bench& bench_;
  const std::vector<CaptureInfo>& captures_;
  IntensityLaw law_;
  int scans_;
  double sigma_mm_;
  std::vector<TrackPose> track_;
};

}  // namespace fit::explain
