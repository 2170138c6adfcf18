// SPDX-License-Identifier: MIT
#include "rig/investigate/one_clock.hpp"

#include <cmath>

#include "rig/session/session_dates.hpp"

namespace rig::investigate {
namespace {

class Shifted final : public fit::Recording {
 public:
  Shifted(std::unique_ptr<fit::Recording> recording, std::int64_t shift_us, std::optional<double> on_for_s)
      : recording_(std::move(recording)), shift_us_(shift_us), captures_(recording_->captures()) {
    for (fit::CaptureInfo& c : captures_) {
      c.started_us += shift_us_;
      if (!c.since_power_on_s && on_for_s)
        c.since_power_on_s = *on_for_s + static_cast<double>(c.started_us) * 1e-6;
    }
    track_ = recording_->track();
    for (fit::TrackPose& pose : track_) pose.host_us += shift_us_;
  }
  const fit::Bench& bench() const override { return recording_->bench(); }
  const std::vector<fit::CaptureInfo>& captures() const override { return captures_; }
  const std::vector<fit::TrackPose>& track() const override { return track_; }
  void for_each_scan(std::size_t index,
                     const std::function<void(const fit::ScanView&)>& visit) const override {
    recording_->for_each_scan(index, [&](const fit::ScanView& scan) {
      fit::ScanView shifted = scan;
      shifted.host_us += shift_us_;
      visit(shifted);
    });
  }

 private:
  std::unique_ptr<fit::Recording> recording_;
  std::int64_t shift_us_;
  std::vector<fit::CaptureInfo> captures_;
  std::vector<fit::TrackPose> track_;
};

/// A scan by all three clocks.
struct Moment {
  std::int64_t device_ms = 0, session_us = 0, computer_us = 0;
};

Moment moment_of(const fit::Recording& recording, std::size_t capture, bool last, std::int64_t epoch) {
  Moment m;
  bool seen = false;
  recording.for_each_scan(capture, [&](const fit::ScanView& scan) {
    if (seen && !last) return;
    seen = true;
    m = {scan.device_ms, scan.host_us, epoch + scan.host_us};
  });
  return m;
}

}  // namespace

double passed_s(std::int64_t device_ms_before, std::int64_t device_ms_after, double computer_s) {
  constexpr std::int64_t wrap_ms = 1 << 24;  // of SCIP's time stamps
  constexpr double longest_s = 3600;         // that a simulation may run ahead between two sessions
  const std::int64_t ms = (((device_ms_after - device_ms_before) % wrap_ms) + wrap_ms) % wrap_ms;
  const double device_s = static_cast<double>(ms) * 1e-3;
  if (std::abs(device_s - computer_s) <= 1 + 0.01 * std::abs(computer_s)) return device_s;
  return device_s < longest_s && computer_s < 60 ? device_s : std::max(0.0, computer_s);
}

std::vector<std::unique_ptr<fit::Recording>> on_one_clock(
    const std::vector<std::unique_ptr<SessionStore>>& sessions, const fit::Bench& bench,
    std::optional<double> on_for_s) {
  std::vector<std::unique_ptr<fit::Recording>> list;
  std::int64_t shift_us = 0;
  std::optional<Moment> before;  // The last scan so far; its session_us on the common clock.
  for (const auto& session : sessions) {
    auto recording = session->recording(bench);
    const std::int64_t epoch = epoch_unix_us(*session).value_or(0);
    const std::size_t count = recording->captures().size();
    if (count > 0) {
      const Moment first = moment_of(*recording, 0, false, epoch);
      if (before) {
        const double computer_s = static_cast<double>(first.computer_us - before->computer_us) * 1e-6;
        const double gap_s = passed_s(before->device_ms, first.device_ms, computer_s);
        shift_us =
            before->session_us + static_cast<std::int64_t>(std::llround(gap_s * 1e6)) - first.session_us;
      }
      before = moment_of(*recording, count - 1, true, epoch);
      before->session_us += shift_us;
      // A cold start: from here on the lidar is on for as long as that session says.
      const fit::CaptureInfo& latest = recording->captures().back();
      const auto stated = latest.since_power_on_s;
      const std::int64_t at_us = latest.started_us + shift_us;
      list.push_back(std::make_unique<Shifted>(std::move(recording), shift_us, on_for_s));
      if (stated) on_for_s = *stated - static_cast<double>(at_us) * 1e-6;
      continue;
    }
    list.push_back(std::make_unique<Shifted>(std::move(recording), shift_us, on_for_s));
  }
  return list;
}

}  // namespace rig::investigate
