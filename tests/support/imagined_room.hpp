// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <functional>
#include <memory>
#include <random>

#include "../unit/fit/synthetic_recording.hpp"
#include "fit/explain/scene/scene.hpp"

/// A room seen all round by a lidar on a stage, with something concealed: `bend` turns beams (rad), `stretch`
/// lengthens ranges (mm); both may depend on the beam angle, the true range and the time.
struct ImaginedRoom {
  using Bend = std::function<double(double beam_rad)>;
  using Stretch = std::function<double(double beam_rad, double range_mm, double time_s)>;
  Bend bend = [](double) { return 0.0; };
  /// Of all ranges of one turn of the mirror (mm), counted through the time between captures.
  std::function<double(std::int64_t turn)> face = [](std::int64_t) { return 0.0; };
  double third_wall_turned_deg = 0;  ///< Counter-clockwise about its middle.
  Stretch stretch = [](double, double, double) { return 0.0; };
  int captures = 16, scans = 8, every_beam = 4;
  double sigma_mm = 5;
  double pause_s = 60;    ///< From the start of a capture to that of the next.
  double rate_deg_s = 0;  ///< The stage turns during captures, both ways in turn.
  unsigned seed = 1;
  bool thermometer = false;

  [[nodiscard]] static fit::Bench bench() {
    fit::Bench b;
    b.lidar.mount = {{0, 3}, {0, 3}, {0, 0.3 * fit::rad_per_deg}};
    const std::vector<Eigen::Vector2d> corners{{2600, -1900}, {2300, 3100}, {-1700, 3100}, {-1700, -1900}};
    for (std::size_t i = 0; i < 4; ++i) {
      fit::Target wall;
      wall.name = "wall " + std::to_string(i + 1);
      wall.from_mm = corners[i];
      wall.to_mm = corners[(i + 1) % 4];
      wall.u_mm = 1.5;
      wall.u_rad = 0.1 * fit::rad_per_deg;
      wall.reflectance = 0.4 + 0.1 * static_cast<double>(i);
      b.targets.push_back(wall);
    }
    b.known.push_back({"range-noise", {{"sigma_mm", {5, 1}}}, {}});
    return b;
  }

  [[nodiscard]] SyntheticRecording record() const {
    fit::Bench b = bench();
    b.lidar.steps = (b.lidar.steps - 1) / every_beam + 1;
    b.lidar.front_step /= every_beam;
    b.lidar.step_rad *= every_beam;
    auto random = std::make_shared<std::mt19937>(seed);
    fit::explain::Nuisance truth(b);
    std::normal_distribution<double> normal;
    truth.x_mm += 3 * normal(*random);
    truth.y_mm += 3 * normal(*random);
    truth.yaw_rad += 0.3 * fit::rad_per_deg * normal(*random);
    for (fit::Displacement& target : truth.targets) target.out_mm += 1.5 * normal(*random);
    truth.targets[2].turn_rad += third_wall_turned_deg * fit::rad_per_deg;
    const auto self = std::make_shared<const ImaginedRoom>(*this);
    SyntheticRecording recording(b, [=](const fit::CaptureInfo& info, std::int64_t seq, auto& range,
                                        auto& intensity) {
      std::normal_distribution<double> noise(0, self->sigma_mm);
      const double of_face =
          self->face(std::llround(info.since_power_on_s.value_or(0) * b.lidar.scan_hz) + seq);
      const fit::explain::Scene scene(b, truth, info);
      for (std::size_t k = 0; k < range.size(); ++k) {
        const double beam = b.lidar.beam_angle(info.first_step + static_cast<double>(k));
        fit::Effect effect;
        effect.beam_rad = self->bend(beam);
        const double stage =
            info.stage_rad + info.stage_rate_rad_s * static_cast<double>(seq) / b.lidar.scan_hz;
        const auto sight = scene.look(stage, beam, effect);
        const double more = self->stretch(beam, sight.range_mm, info.since_power_on_s.value_or(0));
        range[k] = static_cast<std::uint16_t>(std::lround(sight.range_mm + more + of_face + noise(*random)));
        intensity[k] = static_cast<std::uint16_t>(3e6 * std::cos(sight.incidence_rad) / sight.range_mm);
      }
    });
    for (int i = 0; i < captures; ++i) {
      fit::CaptureInfo info;
      const int turn = i < captures / 2 ? i : captures - 1 - i;
      info.stage_rad = 720.0 / captures * turn * fit::rad_per_deg;
      info.approach = i == 0 ? 0 : i <= captures / 2 ? 1 : -1;
      info.stage_rate_rad_s = (i % 2 == 0 ? 1 : -1) * rate_deg_s * fit::rad_per_deg;
      info.since_power_on_s = 30 + pause_s * i;
      if (thermometer) info.temperature_c = 20 + 10 * (1 - std::exp(-*info.since_power_on_s / 400));
      info.last_step = b.lidar.steps - 1;
      recording.add(info, scans);
    }
    return recording;
  }
};
