// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <vector>

#include "fit/recording.hpp"

/// A recording made scan by scan by a function: nothing is kept, so long recordings cost no memory.
class SyntheticRecording : public fit::Recording {
 public:
  /// Fills ranges and intensities of one scan of a capture.
  using Maker = std::function<void(const fit::CaptureInfo&, std::int64_t seq,
                                   std::vector<std::uint16_t>& range, std::vector<std::uint16_t>& intensity)>;

  SyntheticRecording(fit::Bench bench, Maker maker) : bench_(std::move(bench)), maker_(std::move(maker)) {}

  void add(fit::CaptureInfo capture, long scans) {
    capture.id = static_cast<std::int64_t>(captures_.size()) + 1;
    captures_.push_back(std::move(capture));
    scans_.push_back(scans);
  }
  const Maker& maker() const { return maker_; }
  const fit::Bench& bench() const override { return bench_; }
  const std::vector<fit::CaptureInfo>& captures() const override { return captures_; }
  const std::vector<fit::TrackPose>& track() const override { return track_; }
  void for_each_scan(std::size_t index,
                     const std::function<void(const fit::ScanView&)>& visit) const override {
    const fit::CaptureInfo& capture = captures_.at(index);
    std::vector<std::uint16_t> range(static_cast<std::size_t>(capture.beams())), intensity(range.size());
    const auto first_ms = static_cast<std::int64_t>(1000 * capture.since_power_on_s.value_or(0));
    for (long seq = 0; seq < scans_[index]; ++seq) {
      maker_(capture, seq, range, intensity);
      visit({seq, first_ms + seq * 25, seq * 25000, range, intensity, {}});
    }
  }

 private:
  fit::Bench bench_;
  Maker maker_;
  std::vector<fit::CaptureInfo> captures_;
  std::vector<long> scans_;
  std::vector<fit::TrackPose> track_;
};
