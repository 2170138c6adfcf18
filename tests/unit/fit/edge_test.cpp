// SPDX-License-Identifier: MIT
#include "fit/range/edge.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <random>

#include "fit/numeric/distributions.hpp"
#include "synthetic_recording.hpp"

namespace edge_test {
namespace {

constexpr double deg = fit::rad_per_deg;

enum class Shape { ramp, gaussian };

/// A board at 1.5 m square to the view, its right edge at bearing `edge_deg`, a background 0.8 m behind;
/// beams see behind with a probability that rises across the window. The stage stops exactly, or, with a
/// `resolution_deg`, anywhere within it.
SyntheticRecording edge_bench(double edge_deg, double window_deg, Shape shape, unsigned seed,
                              double drift_mm_per_deg = 0, bool background = true,
                              double resolution_deg = 0) {
  auto random = std::make_shared<std::mt19937_64>(seed);
  fit::Bench bench;
  bench.stage_resolution_rad = resolution_deg * deg;
  return {bench, [=](const fit::CaptureInfo& capture, std::int64_t, auto& range, auto& intensity) {
            std::normal_distribution<double> noise(0, 4);
            std::uniform_real_distribution<double> chance;
            const fit::LidarGeometry lidar;
            // The same for every scan of a stop.
            std::mt19937_64 of_stop(
                seed + static_cast<std::uint64_t>(std::lround(1e6 + 1e4 * capture.stage_rad / deg)));
            const double off_deg = resolution_deg * (std::uniform_real_distribution<double>()(of_stop) - 0.5);
            for (std::size_t k = 0; k < range.size(); ++k) {
              const double bearing =
                  (capture.stage_rad + lidar.beam_angle(capture.first_step + static_cast<double>(k))) / deg +
                  off_deg;
              const double along = (edge_deg - bearing) / window_deg;
              const double behind = shape == Shape::ramp ? std::clamp(0.5 + along, 0.0, 1.0)
                                                         : std::erfc(-along * 4.6527 / std::sqrt(2.0)) / 2;
              const bool sees_behind = chance(*random) < behind;
              const double level = (sees_behind ? 2300 : 1500) + drift_mm_per_deg * (bearing - edge_deg);
              range[k] = static_cast<std::uint16_t>(std::lround(level + noise(*random)));
              if (sees_behind && !background) range[k] = 0;
              intensity[k] = 1800;
            }
          }};
}

void sweep(SyntheticRecording& recording, double from_deg, double to_deg, double step_deg, long scans,
           const std::string& step = {}) {
  for (double angle = from_deg; angle < to_deg + 1e-9; angle += step_deg) {
    fit::CaptureInfo capture;
    capture.stage_rad = angle * deg;
    capture.approach = 1;
    capture.target = "board";
    capture.step = step;
    capture.first_step = 540, capture.last_step = 544;
    recording.add(capture, scans);
  }
}

/// The beam of step 540 points along the stage's angle.
const fit::EdgeCrossing& front_beam(const std::vector<fit::EdgeCrossing>& crossings) {
  for (const auto& crossing : crossings)
    if (crossing.step == 540) return crossing;
  FAIL("the front beam's crossing was not found");
  return crossings.front();
}

/// A board, and 800 mm behind it a background that a scan sees where that says so.
SyntheticRecording board_before_background(
    std::function<bool(double stage_deg, std::int64_t seq)> sees_behind) {
  return {fit::Bench{}, [=](const fit::CaptureInfo& capture, std::int64_t seq, auto& range, auto& intensity) {
            const bool behind = sees_behind(capture.stage_rad / deg, seq);
            std::ranges::fill(range, static_cast<std::uint16_t>((behind ? 2300 : 1500) + seq % 7 - 3));
            std::ranges::fill(intensity, std::uint16_t{1800});
          }};
}

}  // namespace

TEST_CASE("a sweep over a board's edge gives its angle and the window of jitter as in the paper") {
  auto recording = edge_bench(40.023, 0.05, Shape::ramp, 1);
  sweep(recording, 39.9, 40.15, 0.01, 1000);
  const auto crossings = fit::find_edge_crossings(recording);
  const auto& crossing = front_beam(crossings);
  CHECK(crossing.right);
  CHECK(std::abs(crossing.response.edge_rad.value / deg - 40.023) < 3 * crossing.response.edge_rad.u / deg);
  CHECK(crossing.response.edge_rad.u / deg < 0.001);
  CHECK(std::abs(crossing.response.window_rad.value / deg - 0.05) < 3 * crossing.response.window_rad.u / deg);
  CHECK(crossing.response.window_rad.u / deg < 0.003);
  CHECK(crossing.response.ramp_probability > 0.9);
  REQUIRE(crossing.counted);
  CHECK(crossing.counted->first_rad / deg == Approx(40.00));
  CHECK(crossing.counted->last_rad / deg == Approx(40.04));
  CHECK(crossing.counted->step_rad / deg == Approx(0.01));
}

TEST_CASE("the window is counted in the sweep's own stops, also where a search stopped between them") {
  auto recording = edge_bench(40.023, 0.05, Shape::ramp, 1);
  sweep(recording, 39.905, 40.155, 0.05, 200, "find-edge 1");
  sweep(recording, 40.003, 40.04, 0.017, 200, "find-edge 1");
  sweep(recording, 39.9, 40.15, 0.01, 1000, "sweep 2");
  const auto crossings = fit::find_edge_crossings(recording);
  const auto& crossing = front_beam(crossings);
  CHECK(crossing.step_rad / deg < 0.006);
  REQUIRE(crossing.counted);
  CHECK(crossing.counted->first_rad / deg == Approx(40.00));
  CHECK(crossing.counted->last_rad / deg == Approx(40.04));
  CHECK(crossing.counted->width_rad() / deg == Approx(0.05));
}

TEST_CASE(
    "six samples of a thousand on the background are jitter, though the stop at the end is a short one") {
  SyntheticRecording recording = board_before_background([](double stage_deg, std::int64_t seq) {
    if (stage_deg < 40.045) return true;
    if (stage_deg < 40.095) return seq % 4 == 0;
    return stage_deg < 40.105 && seq < 6;  // All further out see the board alone.
  });
  sweep(recording, 39.9, 40.2, 0.01, 1000, "sweep 2");
  sweep(recording, 40.25, 40.251, 0.01, 200, "find-edge 1");
  const auto crossings = fit::find_edge_crossings(recording);
  const auto& crossing = front_beam(crossings);
  REQUIRE(crossing.counted);
  CHECK(crossing.counted->last_rad / deg == Approx(40.10));
}

TEST_CASE("what leaves a gate by chance does so as often as stated, with few stops to compare as with many") {
  std::mt19937_64 random(3);
  for (const double share : {0.01, 0.1})
    for (const long stops : {1, 2, 30}) {
      std::binomial_distribution<long> in_one(1000, share), in_others(1000 * stops, share);
      int beyond = 0;
      for (int i = 0; i < 20000; ++i) {
        const auto others = static_cast<double>(in_others(random)), n = 1000.0 * static_cast<double>(stops);
        beyond += fit::beta_binomial_at_least(1000, others + 1, n - others + 1,
                                              static_cast<double>(in_one(random))) < 1e-3;
      }
      INFO(share << ", " << stops);
      CHECK(beyond <= 34);  // 20, and three standard deviations of the count.
    }
  CHECK(fit::beta_binomial_at_least(1000, 1e9, 9e9, 120) ==
        Approx(fit::binomial_at_least(1000, 0.1, 120)).epsilon(1e-3));
  CHECK(fit::beta_binomial_at_least(10, 1, 1, 4) == Approx(7.0 / 11));
  CHECK(fit::beta_binomial_at_least(10, 1, 1, 8) == Approx(3.0 / 11));
}

TEST_CASE("a stop that jitters by chance between two of one surface is no window") {
  SyntheticRecording recording = board_before_background([](double stage_deg, std::int64_t seq) {
    const bool passes_by = std::abs(stage_deg - 40.25) < 1e-6 && seq % 5 == 0;
    return stage_deg < 39.98 || (stage_deg < 40.03 && seq % 2 == 0) || passes_by;
  });
  sweep(recording, 39.905, 40.155, 0.05, 500, "find-edge 1");
  sweep(recording, 40.2, 40.3, 0.01, 500, "sweep 2");
  const auto crossings = fit::find_edge_crossings(recording);
  const auto& crossing = front_beam(crossings);
  REQUIRE(crossing.counted);
  CHECK(crossing.counted->step_rad / deg == Approx(0.05));
}

TEST_CASE("strays of the surface itself are no jitter, however many stops have them") {
  auto random = std::make_shared<std::mt19937_64>(7);
  fit::Bench bench;
  SyntheticRecording recording(
      bench, [=](const fit::CaptureInfo& capture, std::int64_t, auto& range, auto& intensity) {
        std::uniform_real_distribution<double> chance;
        const double along = 0.5 + (40.023 - capture.stage_rad / deg) / 0.05;
        for (auto& value : range)
          value = static_cast<std::uint16_t>((chance(*random) < along ? 2300 : 1500) +
                                             (chance(*random) < 0.004 ? 60 : 0) +
                                             std::lround(6 * chance(*random)));
        std::ranges::fill(intensity, std::uint16_t{1800});
      });
  sweep(recording, 39.85, 40.2, 0.01, 1000, "sweep 2");
  for (const auto& crossing : fit::find_edge_crossings(recording)) {
    if (crossing.step != 540) continue;
    REQUIRE(crossing.counted);
    CHECK(crossing.counted->width_rad() / deg == Approx(0.05).margin(0.011));
  }
}

TEST_CASE("where the stage stops within its resolution, edge and window are as uncertain as that") {
  constexpr int sweeps = 60;
  int edge_inside = 0, window_inside = 0;
  double worst = 0;
  for (unsigned seed = 0; seed < sweeps; ++seed) {
    auto recording = edge_bench(40.023, 0.05, Shape::ramp, 1000 * seed + 3, 0, true, 0.01);
    sweep(recording, 39.9, 40.15, 0.01, 1000);
    const auto crossings = fit::find_edge_crossings(recording);
    const fit::EdgeResponse& found = front_beam(crossings).response;
    const auto pull = [](const fit::Estimate& estimate, double truth_deg) {
      return std::abs(estimate.value / deg - truth_deg) / (estimate.u / deg);
    };
    edge_inside += pull(found.edge_rad, 40.023) < 2;
    window_inside += pull(found.window_rad, 0.05) < 2;
    worst = std::max({worst, pull(found.edge_rad, 40.023), pull(found.window_rad, 0.05)});
  }
  // 95 % of them; three standard deviations of the count below.
  CHECK(edge_inside >= 52);
  CHECK(window_inside >= 52);
  CHECK(worst < 4);
}

TEST_CASE("an edge with nothing behind it is found as well") {
  auto recording = edge_bench(40.023, 0.05, Shape::ramp, 5, 0, false);
  sweep(recording, 39.9, 40.15, 0.01, 500);
  sweep(recording, 35, 39.8, 0.2, 500);  // Most stops see nothing at all.
  const auto crossings = fit::find_edge_crossings(recording);
  const auto& crossing = front_beam(crossings);
  CHECK(crossing.back_mm == 0);
  CHECK(std::abs(crossing.response.edge_rad.value / deg - 40.023) < 3 * crossing.response.edge_rad.u / deg);
  CHECK(crossing.response.edge_rad.u / deg < 0.001);
  CHECK(std::abs(crossing.response.window_rad.value / deg - 0.05) < 3 * crossing.response.window_rad.u / deg);
}

TEST_CASE("edge and window lie within k = 2 of the truth as often as promised") {
  for (const Shape shape : {Shape::ramp, Shape::gaussian}) {
    int edge_inside = 0, window_inside = 0;
    constexpr int seeds = 50;
    for (unsigned seed = 0; seed < seeds; ++seed) {
      const double edge = 40.02 + 0.0002 * seed;
      auto recording = edge_bench(edge, 0.06, shape, 100 + seed);
      sweep(recording, 39.9, 40.15, 0.01, 200);
      const auto crossings = fit::find_edge_crossings(recording);
      const auto& response = front_beam(crossings).response;
      edge_inside += std::abs(response.edge_rad.value / deg - edge) < 2 * response.edge_rad.u / deg;
      window_inside += std::abs(response.window_rad.value / deg - 0.06) < 2 * response.window_rad.u / deg;
    }
    INFO((shape == Shape::ramp ? "ramp" : "gaussian")
         << ": edge " << edge_inside << ", window " << window_inside);
    CHECK(edge_inside >= 44);
    CHECK(window_inside >= 44);
  }
}

TEST_CASE("a window narrower than a step is bounded from above, not invented") {
  auto recording = edge_bench(40.025, 0.002, Shape::ramp, 3);
  sweep(recording, 39.9, 40.15, 0.01, 300);
  const auto crossings = fit::find_edge_crossings(recording);
  const auto& response = front_beam(crossings).response;
  CHECK(response.stops_inside == 0);
  CHECK(response.window_rad.u > response.window_rad.value / 4);
  CHECK(std::abs(response.edge_rad.value / deg - 40.025) < 2 * response.edge_rad.u / deg);
}

TEST_CASE("a slanted board's drifting range is not taken for jitter") {
  auto recording = edge_bench(40.02, 0.05, Shape::ramp, 4, 15);
  sweep(recording, 39.0, 41.0, 0.05, 200);
  sweep(recording, 39.97, 40.08, 0.01, 200);
  const auto crossings = fit::find_edge_crossings(recording);
  const auto& crossing = front_beam(crossings);
  REQUIRE(crossing.counted);
  CHECK(crossing.counted->first_rad / deg > 39.98);
  CHECK(crossing.counted->last_rad / deg < 40.06);
  CHECK(std::abs(crossing.response.edge_rad.value / deg - 40.02) < 3 * crossing.response.edge_rad.u / deg);
}

}  // namespace edge_test
