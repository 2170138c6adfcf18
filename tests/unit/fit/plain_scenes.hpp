// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "fit/bench/bench.hpp"
#include "plain_bench.hpp"
#include "synthetic_recording.hpp"

/// Scenes of walls and posts of any shape and recordings of them, by plane trigonometry alone.
namespace plain_bench {

struct Post {
  Point centre;
  double radius;
};

/// What stands there: what the bench file says. Where it stands is drawn from the uncertainties.
struct PlainScene {
  std::vector<Wall> walls;
  std::vector<Post> posts = {};
  double u_mm = 1.5, u_deg = 0.1;
  /// Of the lidar.
  int steps = 541, front_step = 270;
  double step_deg = 0.5;
  double u_mount_mm = 3, u_yaw_deg = 0.3;
  double sigma_mm = 5, u_sigma_mm = 0.3;  ///< Of a sample.
};

inline std::string number(double value) { return std::to_string(value); }

inline fit::Bench bench_of(const PlainScene& scene) {
  const auto point = [](Point p) { return "[" + number(p.real()) + "," + number(p.imag()) + "]"; };
  std::string text = R"({"schema": "bench/1", "lidar": {"scan_hz": 40, "steps": )" +
                     std::to_string(scene.steps) + R"(, "front_step": )" + std::to_string(scene.front_step) +
                     R"(, "step_deg": )" + number(scene.step_deg) +
                     R"(, "mount": {"x_mm": {"value": 0, "u": )" + number(scene.u_mount_mm) +
                     R"(}, "y_mm": {"value": 0, "u": )" + number(scene.u_mount_mm) +
                     R"(}, "yaw_deg": {"value": 0, "u": )" + number(scene.u_yaw_deg) + R"(}}}, "targets": [)";
  std::string separator;
  for (std::size_t i = 0; i < scene.walls.size(); ++i, separator = ",")
    text += separator + R"({"name": "wall )" + std::to_string(i + 1) + R"(", "from_mm": )" +
            point(scene.walls[i].from) + R"(, "to_mm": )" + point(scene.walls[i].to) + R"(, "u_mm": )" +
            number(scene.u_mm) + R"(, "u_deg": )" + number(scene.u_deg) + "}";
  for (std::size_t i = 0; i < scene.posts.size(); ++i, separator = ",")
    text += separator + R"({"name": "post )" + std::to_string(i + 1) + R"(", "centre_mm": )" +
            point(scene.posts[i].centre) + R"(, "radius_mm": )" + number(scene.posts[i].radius) +
            R"(, "u_mm": )" + number(scene.u_mm) + R"(, "u_radius_mm": 0.3})";
  return fit::parse_bench(
      text + R"(], "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": {"value": )" +
      number(scene.sigma_mm) + R"(, "u": )" + number(scene.u_sigma_mm) + "}}}]}");
}

/// The scene as it really stands; corners stay corners.
inline PlainScene drawn(PlainScene scene, std::mt19937& random, bool walls = true) {
  std::normal_distribution<double> normal;
  if (!walls) return scene;
  const std::vector<Wall> stated = scene.walls;
  for (Wall& wall : scene.walls) {
    const Point along = (wall.to - wall.from) / std::abs(wall.to - wall.from),
                middle = (wall.from + wall.to) / 2.0;
    const Point shift = along * Point(0, scene.u_mm * normal(random));
    const Point turn = std::polar(1.0, scene.u_deg * degree * normal(random));
    const Point half = (wall.to - wall.from) / 2.0 * turn;
    wall = {middle + shift - half, middle + shift + half};
  }
  const auto crossed = [](const Wall& a, const Wall& b) {
    const Point u = a.to - a.from, v = b.to - b.from, w = b.from - a.from;
    const double d = u.real() * v.imag() - u.imag() * v.real();
    return a.from + u * ((w.real() * v.imag() - w.imag() * v.real()) / d);
  };
  const std::vector<Wall> moved = scene.walls;
  for (std::size_t i = 0; i < stated.size(); ++i)
    for (std::size_t j = 0; j < stated.size(); ++j) {
      if (i == j) continue;
      for (const auto own : {&Wall::from, &Wall::to})
        for (const auto other : {&Wall::from, &Wall::to})
          if (std::abs(stated[i].*own - stated[j].*other) < 1)
            scene.walls[i].*own = crossed(moved[i], moved[j]);
    }
  for (Post& post : scene.posts) post.centre += scene.u_mm * Point(normal(random), normal(random));
  return scene;
}

/// What a beam meets among walls and posts.
inline std::optional<Met> look(const PlainScene& scene, const Mount& mount, double stage_rad, double beam_rad,
                               const Deviation& off = {}) {
  std::optional<Met> nearest = look(scene.walls, mount, stage_rad, beam_rad, off);
  const double stage = stage_rad + off.stage_rad;
  const Point start = std::polar(1.0, stage) * Point(mount.x_mm, mount.y_mm) + off.origin_mm;
  const Point turn = std::polar(1.0, -(stage + mount.yaw_deg * degree + beam_rad + off.beam_rad));
  for (std::size_t i = 0; i < scene.posts.size(); ++i) {
    const Point way = (scene.posts[i].centre - start) * turn;
    const double r = scene.posts[i].radius, inside = r * r - way.imag() * way.imag();
    if (inside <= 0 || way.real() <= 0) continue;
    const double range = way.real() - std::sqrt(inside) + off.range_mm;
    if (nearest && nearest->range_mm <= range) continue;
    nearest = Met{scene.walls.size() + i, range, std::asin(-way.imag() / r), 0};
  }
  return nearest;
}

/// What is concealed in one sample of one beam.
struct Sample {
  double beam_rad, stage_rad, time_s, range_mm, incidence_rad;
  std::int64_t seq;
  std::size_t target;
};
using Conceal = std::function<Deviation(double beam_rad, double stage_rad, double time_s)>;
using Spoil =
    std::function<double(const Sample&, std::mt19937&)>;  ///< Another range (mm) of a sample; 0: none.

/// A receiver that times all light of a wide beam reads the mean over what it meets, but for what lies far
/// behind: that is another echo.
inline Conceal mean_over_beam(const PlainScene& scene, double width_deg) {
  return [=](double beam_rad, double stage_rad, double) {
    constexpr double another_echo_mm = 500, step = 0.1;
    const auto middle = look(scene, {}, stage_rad, beam_rad);
    if (!middle) return Deviation{};
    double light = 0, sum_mm = 0;
    for (int k = -30; k <= 30; ++k) {
      const Deviation aside{.beam_rad = k * step * width_deg * degree};
      const auto there = look(scene, {}, stage_rad, beam_rad, aside);
      if (!there || std::abs(there->range_mm - middle->range_mm) > another_echo_mm) continue;
      const double share = std::exp(-std::pow(k * step, 2) / 2) * std::cos(there->incidence_rad) /
                           std::pow(there->range_mm, 2);
      light += share;
      sum_mm += share * (there->range_mm - middle->range_mm);
    }
    return Deviation{.range_mm = sum_mm / light};
  };
}

/// The scene seen by a lidar whose mount is drawn from its uncertainties too; intensities by 1/r and the
/// cosine. `written`: the bench file says that instead.
inline SyntheticRecording recorded(const PlainScene& stated, unsigned seed, const Conceal& conceal,
                                   const Spoil& spoil = {}, const std::optional<PlainScene>& written = {}) {
  auto random = std::make_shared<std::mt19937>(seed);
  std::normal_distribution<double> normal;
  const PlainScene scene = drawn(stated, *random);
  const Mount mount{stated.u_mount_mm * normal(*random), stated.u_mount_mm * normal(*random),
                    stated.u_yaw_deg * normal(*random)};
  const fit::Bench bench = bench_of(written.value_or(stated));
  return {
      bench, [=](const fit::CaptureInfo& info, std::int64_t seq, auto& range, auto& intensity) {
        std::normal_distribution<double> noise(0, scene.sigma_mm);
        const double time_s = info.since_power_on_s.value_or(0) + 0.025 * static_cast<double>(seq);
        for (std::size_t k = 0; k < range.size(); ++k) {
          const double beam =
              (static_cast<double>(info.first_step) + static_cast<double>(k) - scene.front_step) *
              scene.step_deg * degree;
          const auto met = look(scene, mount, info.stage_rad, beam, conceal(beam, info.stage_rad, time_s));
          range[k] = intensity[k] = 0;
          if (!met) continue;
          double seen = met->range_mm + noise(*random);
          if (spoil)
            seen = spoil({beam, info.stage_rad, time_s, seen, met->incidence_rad, seq, met->wall}, *random);
          if (seen < 30 || seen > 60000) continue;
          range[k] = static_cast<std::uint16_t>(std::lround(seen));
          intensity[k] = static_cast<std::uint16_t>(3e6 * std::cos(met->incidence_rad) / met->range_mm);
        }
      }};
}

/// Stops all round, up and back, so many scans each.
inline void turn_round(SyntheticRecording& recording, const PlainScene& scene, int stops = 14,
                       int scans = 10) {
  for (int i = 0; i < stops; ++i) {
    fit::CaptureInfo capture;
    const int turn = i <= stops / 2 ? i : stops - i;
    capture.stage_rad = (turn * 41.3 - 140) * degree;
    capture.approach = i == 0 ? 0 : i <= stops / 2 ? 1 : -1;
    capture.last_step = scene.steps - 1;
    capture.since_power_on_s = 1800 + 20 * i;
    capture.started_us = 20000000LL * i;
    recording.add(capture, scans);
  }
}

inline const std::vector<Wall> l_shaped{{{3200, -2100}, {3200, 1400}},   {{3200, 1400}, {900, 1400}},
                                        {{900, 1400}, {900, 4200}},      {{900, 4200}, {-2300, 4200}},
                                        {{-2300, 4200}, {-2300, -2100}}, {{-2300, -2100}, {3200, -2100}}};
/// Two long walls, open at both ends, with a board across one of them.
inline const std::vector<Wall> corridor{
    {{-5200, -900}, {5600, -950}}, {{5600, 1050}, {-5200, 1000}}, {{4700, -300}, {4600, 350}}};
/// A room with a free-standing board before a wall, and a wall that ends.
inline const std::vector<Wall> furnished{{{2900, -2400}, {2900, 2600}},  {{2900, 2600}, {-2700, 2300}},
                                         {{-2700, 2300}, {-2700, -600}}, {{-2700, -2400}, {2900, -2400}},
                                         {{1500, -500}, {1400, 300}},    {{-900, -1500}, {-200, -1700}}};

}  // namespace plain_bench
