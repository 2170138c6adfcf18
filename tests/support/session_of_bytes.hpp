// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "../unit/fit/synthetic_recording.hpp"
#include "fit/bench/bench.hpp"

/// A small session whose bench, captures and scans are whatever these bytes say: walls and posts anywhere,
/// with or without uncertainties, temperatures, times and intensities; ranges near what a wall would give, or
/// anything.
class SessionOfBytes {
 public:
  explicit SessionOfBytes(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}

  [[nodiscard]] SyntheticRecording recording() {
    fit::Bench bench;
    bench.lidar.steps = 8 + byte() % 64;
    bench.lidar.front_step = bench.lidar.steps / 2;
    bench.lidar.step_rad = (0.25 + byte() / 64.0) * fit::rad_per_deg;
    bench.lidar.mount = {
        {0, uncertainty()}, {byte() / 16.0, uncertainty()}, {0, uncertainty() * fit::rad_per_deg}};
    for (int count = 1 + byte() % 5, i = 0; i < count; ++i) {
      fit::Target target;
      target.name = "t" + std::to_string(i);
      target.u_mm = uncertainty();
      target.u_rad = uncertainty() * fit::rad_per_deg;
      if (byte() % 4 == 0) {
        const Eigen::Vector2d centre = place() + Eigen::Vector2d(300, 0);
        target.set_round({centre, 1 + std::min(250.0, centre.norm() / 2), uncertainty()});
      } else {
        target.from_mm = place();
        target.to_mm = target.from_mm + place() + Eigen::Vector2d(1, 2);
        if ((target.to_mm - target.from_mm).norm() < 1) target.to_mm.x() += 10;
      }
      bench.targets.push_back(target);
    }
    if (byte() % 2)
      bench.known.push_back({"range-noise", {{"sigma_mm", {1.0 * byte() / 8, uncertainty()}}}, {}});
    const bool is_lit = byte() % 2, is_wild = byte() % 8 == 0;
    std::vector<std::uint8_t> noise;
    for (int i = 0; i < 64; ++i) noise.push_back(byte());
    SyntheticRecording made(bench, [=, n = std::size_t{0}](const fit::CaptureInfo& info, std::int64_t,
                                                           auto& range, auto& intensity) mutable {
      for (std::size_t k = 0; k < range.size(); ++k, ++n) {
        const int b = noise[n % noise.size()] ^ static_cast<int>((n * 2654435761U) >> 24 & 0xFF);
        const double far =
            500 + 40.0 * static_cast<double>(k) + 200 * std::cos(info.stage_rad) + info.target_shift_mm;
        range[k] = is_wild       ? static_cast<std::uint16_t>(b * 257)
                   : b % 61 == 0 ? std::uint16_t{0}
                                 : static_cast<std::uint16_t>(std::max(0.0, far + b % 16));
        if (is_lit) intensity[k] = static_cast<std::uint16_t>(b % 7 == 0 ? 0 : 100 + 9 * b);
      }
      if (!is_lit) intensity.clear();
    });
    for (int count = 1 + byte() % 8, i = 0; i < count; ++i) {
      fit::CaptureInfo capture;
      capture.stage_rad = (byte() - 128) * 1.3 * fit::rad_per_deg;
      capture.approach = byte() % 3 - 1;
      if (byte() % 3 == 0) {
        capture.target = "t0";
        capture.target_shift_mm = 30.0 * byte();
      }
      if (byte() % 5 == 0) capture.reflectance = byte() / 255.0;
      if (byte() % 3 == 0) capture.temperature_c = 15 + byte() / 10.0;
      if (byte() % 2) capture.since_power_on_s = 10.0 * i * byte();
      if (byte() % 7 == 0) capture.stage_rate_rad_s = (byte() - 128) / 100.0;
      capture.started_us = 1000000LL * i;
      capture.last_step = bench.lidar.steps - 1;
      made.add(capture, byte() % 12);
    }
    return made;
  }

 private:
  [[nodiscard]] std::uint8_t byte() { return at_ < bytes_.size() ? bytes_[at_++] : std::uint8_t{0}; }
  [[nodiscard]] double uncertainty() { return byte() % 3 == 0 ? 0.0 : byte() / 50.0; }
  [[nodiscard]] Eigen::Vector2d place() {
    const double x = byte(), y = byte();
    return {(x - 100) * 40, (y - 128) * 40};
  }

  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
};
