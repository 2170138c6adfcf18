// SPDX-License-Identifier: MIT
// Deskewing and matching one scan of 1081 beams of a moving lidar, beside point-to-point ICP (Arun's closed
// form) on the same points with the same neighbour search and the same limit of iterations.
#include <benchmark/benchmark.h>

#include "fit/motion/deskew.hpp"
#include "fit/motion/map_fusion.hpp"
#include "tests/support/moving_room.hpp"

namespace {

using fit::Pose2;

constexpr double rate = 40 * room::deg;
constexpr int scans = 200;

room::Pose lidar_at(double t) {
  const double a = rate * t;
  return {80 * std::cos(a), 80 * std::sin(a), a};
}

const Pose2 mount{80, 0, 0};

const std::vector<fit::Sweep>& sweeps() {
  static const std::vector<fit::Sweep> made = [] {
    std::vector<fit::Sweep> out;
    std::mt19937 random(1);
    fit::CaptureInfo capture;
    capture.last_step = 1080;
    for (int i = 0; i < scans; ++i) {
      const auto ranges = room::scan(room::furnished(), lidar_at, 0.025 * i, 5, random);
      fit::ScanView view;
      view.host_us = 25'000 * i;
      view.range_mm = ranges;
      out.push_back(fit::sweep_of(view, capture, {}));
    }
    return out;
  }();
  return made;
}

/// Odometry 3 % wrong, every 20 ms.
fit::Path odometry() {
  std::vector<fit::TimedPose> poses;
  for (double t = 0; t < 0.025 * scans + 1; t += 0.02) poses.push_back({t, {0, 0, 1.03 * rate * t}});
  return fit::Path(poses);
}

void match_and_deskew(benchmark::State& state) {
  const fit::Path path = odometry();
  for (auto _ : state) {
    fit::Fusion fusion(path, mount);
    for (const auto& sweep : sweeps()) benchmark::DoNotOptimize(fusion.add(sweep).end.heading_rad);
  }
  state.SetItemsProcessed(state.iterations() * scans);
  state.counters["goal"] = 1;
}

/// Matching alone: each scan, deskewed beforehand, against the one before.
struct Prepared {
  std::vector<std::vector<Eigen::Vector2d>> points;
  std::vector<Pose2> guess;
};

const Prepared& prepared() {
  static const Prepared made = [] {
    Prepared out;
    const fit::Path path = odometry();
    for (std::size_t i = 0; i < sweeps().size(); ++i) {
      const auto& sweep = sweeps()[i];
      out.points.push_back(fit::deskew(sweep, path, mount));
      const Pose2 before = path.at(sweeps()[i ? i - 1 : 0].begin_s) * mount;
      out.guess.push_back(before.inverse() * (path.at(sweep.begin_s) * mount));
    }
    return out;
  }();
  return made;
}

template <class Match>
void match_scans(benchmark::State& state, const fit::IcpOptions& options, Match match) {
  const Prepared& scene = prepared();
  for (auto _ : state) {
    for (std::size_t i = 1; i < scene.points.size(); ++i) {
      const fit::PointCloud reference(fit::orient_sweep(scene.points[i - 1]));
      benchmark::DoNotOptimize(match(reference, scene.points[i], scene.guess[i], options).pose.x_mm);
    }
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(scene.points.size() - 1));
}

void match_to_lines(benchmark::State& state) {
  match_scans(
      state, {},
      [](const auto& reference, const auto& points, const Pose2& guess, const fit::IcpOptions& options) {
        return fit::match_to_lines(reference, points, guess, {}, options);
      });
}

/// As the paper does it: every point, until it converges.
void match_to_points(benchmark::State& state) {
  fit::IcpOptions options;
  options.most_points = 100'000;
  match_scans(state, options, fit::match_to_points);
}

void match_to_fewer_points(benchmark::State& state) { match_scans(state, {}, fit::match_to_points); }

/// The goal in absolute terms: 1000 scans a second.
void millisecond(benchmark::State& state) {
  for (auto _ : state) state.SetIterationTime(1e-3);
  state.SetItemsProcessed(state.iterations());
}

}  // namespace

BENCHMARK(match_and_deskew)
    ->Name("deskew and match a scan of 1081 beams/ours")
    ->Unit(benchmark::kMillisecond);
BENCHMARK(millisecond)
    ->Name("deskew and match a scan of 1081 beams/limit:1 ms")
    ->UseManualTime()
    ->Iterations(1000)
    ->Unit(benchmark::kMillisecond);
BENCHMARK(match_to_lines)->Name("match two scans of 1081 beams/ours")->Unit(benchmark::kMillisecond);
BENCHMARK(match_to_points)
    ->Name("match two scans of 1081 beams/rival:point-to-point ICP, all points")
    ->Unit(benchmark::kMillisecond);
BENCHMARK(match_to_fewer_points)
    ->Name("match two scans of 1081 beams/rival:point-to-point ICP, 400 points")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_MAIN();
