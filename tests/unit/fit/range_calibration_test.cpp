// SPDX-License-Identifier: MIT
#include "fit/range/range_calibration.hpp"

#include <Eigen/Geometry>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "fit/range/selection.hpp"
#include "fit/range/trend.hpp"
#include "fit/range/validation_measures.hpp"

namespace range_calibration_test {

TEST_CASE("captures are told apart by what was changed: surfaces at one distance, or the distance") {
  std::vector<fit::RangePoint> points;
  for (const double counts : {2400.0, 1800.0, 1200.0, 700.0, 300.0})
    points.push_back({200, 203, 0.1, counts});
  for (int i = 2; i <= 20; ++i) points.push_back({100.0 * i, 100.0 * i + 4, 0.1, 2000.0 - 20 * i});
  fit::sort_into_experiments(points);
  int intensity = 0, distance = 0, both = 0;
  for (const auto& p : points) {
    intensity += p.for_intensity, distance += p.for_distance;
    both += p.for_intensity && p.for_distance;
  }
  CHECK(intensity == 6);  // The carried surface stood at 200 mm too.
  CHECK(distance == 19);
  CHECK(both == 1);
}

TEST_CASE("a quiet device that reports in coarse levels loses no samples, and an outlier is still one") {
  std::vector<fit::Sample> samples;
  for (int i = 0; i < 300; ++i)
    samples.push_back({static_cast<std::uint16_t>(i % 6 == 0 ? 1001 : 1005), 230});
  samples[100].range_mm = 1400;
  const auto mean = fit::select_robust(samples);
  CHECK(mean.kept == 299);
  CHECK(mean.rejected.abnormal == 1);
}

namespace {

/// White noise, and what remembers the value before, rounded to whole millimetres.
std::vector<double> steady_ranges(std::mt19937_64& random, double memory, double sd_of_memory, double sd) {
  std::normal_distribution<double> normal;
  double remembered = sd_of_memory * normal(random);
  std::vector<double> ranges;
  for (int i = 0; i < 1000; ++i) {
    ranges.push_back(std::round(1000 + remembered + sd * normal(random)));
    remembered = memory * remembered + std::sqrt(1 - memory * memory) * sd_of_memory * normal(random);
  }
  return ranges;
}

}  // namespace

TEST_CASE(
    "steady captures seem to drift as seldom as stated, also where samples remember a tenth of a capture") {
  std::mt19937_64 random(11);
  constexpr int sessions = 400;
  for (const auto& [memory, sd_of_memory, sd] : {std::array{0.0, 0.0, 5.0}, std::array{0.7, 7.0, 0.0},
                                                 std::array{0.95, 0.75, 5.0}, std::array{0.98, 0.75, 5.0}}) {
    int often = 0, seldom = 0;
    for (int session = 0; session < sessions; ++session) {
      std::vector<fit::Trend> trends;
      for (int capture = 0; capture < 12; ++capture)
        trends.push_back(fit::trend_of(steady_ranges(random, memory, sd_of_memory, sd)));
      often += fit::drift_together(trends, 0.05), seldom += fit::drift_together(trends, 0.005);
    }
    INFO("memory " << memory);
    CHECK(often <= 34);  // 20, and three standard deviations of the count.
    CHECK(seldom <= 6);  // 2, and as many.
    if (memory == 0.7) CHECK(often >= 4);
  }
}

TEST_CASE("a drift that no capture shows alone is seen in all of them together") {
  std::mt19937_64 random(12);
  std::normal_distribution<double> normal;
  std::vector<fit::Trend> trends;
  for (int capture = 0; capture < 12; ++capture) {
    std::vector<double> ranges;
    for (int i = 0; i < 1000; ++i) ranges.push_back(std::round(1000 + 8 * normal(random) + 1.4 * i / 1000));
    trends.push_back(fit::trend_of(ranges));
  }
  CHECK(std::ranges::none_of(trends, [](const fit::Trend& trend) { return trend.beyond(1e-3 / 12); }));
  CHECK(fit::drift_together(trends, 1e-3));
}

TEST_CASE("the mean of a capture in which the lidar warms up is as uncertain as its drift") {
  std::mt19937_64 random(13);
  std::normal_distribution<double> normal;
  const auto mean_of = [&](double rise_mm) {
    std::vector<fit::Sample> samples;
    for (int i = 0; i < 20000; ++i)
      samples.push_back(
          {static_cast<std::uint16_t>(std::lround(200 + 8 * normal(random) + rise_mm * i / 20000)), 900});
    return fit::select_robust(samples);
  };
  CHECK(mean_of(0).u_mm == Approx(8 / std::sqrt(20000)).epsilon(0.1));
  CHECK(mean_of(0).u_drift_mm == 0);
  const fit::SelectedMean warming = mean_of(5);
  CHECK(std::abs(warming.trend.rise.value - 5) < 3 * warming.trend.rise.u);
  CHECK(warming.u_mm == Approx(5 / std::sqrt(12)).epsilon(0.2));
}

TEST_CASE(
    "A3 as in the paper measures the slant of a wall, and after the plane was removed only its roughness") {
  std::mt19937_64 random(4);
  std::normal_distribution<double> normal;
  std::vector<Eigen::Vector2d> slanted;
  for (int i = -60; i <= 60; ++i) {
    // A plane turned by 30 deg before a lidar with beams every 0.25 deg.
    const double beam = i * 0.25 * M_PI / 180, tilt = M_PI / 6;
    const double range = 1500 * std::cos(tilt) / std::cos(beam - tilt);
    slanted.emplace_back(-range * std::sin(beam), range * std::cos(beam));
  }
  const auto ideal = fit::difference_spread(slanted, 20);
  CHECK(ideal.sd_mm > 5);
  CHECK(ideal.plane_sd_mm < 1e-6);
  int covered = 0;
  for (int run = 0; run < 40; ++run) {
    std::vector<Eigen::Vector2d> noisy;
    for (int i = 0; i < 1000; ++i) noisy.emplace_back(5.0 * i, 1400 + 2 * normal(random));
    const auto white = fit::difference_spread(noisy, 20);
    // White noise s becomes 1.41 s.
    CHECK(white.sd_mm == Approx(2 * std::sqrt(2.0)).epsilon(0.15));
    CHECK(white.pairs == 980);
    covered += white.low_mm < 2 * std::sqrt(2.0) && white.high_mm > 2 * std::sqrt(2.0);
  }
  CHECK(covered >= 34);
}

TEST_CASE(
    "where no distance was measured between two far apart, the correction's uncertainty there is reported") {
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  // Near the lidar the error rises steeply; beyond, hardly.
  const auto error = [](double mm) { return -40 * std::exp(-mm / 180) + 0.0004 * mm; };
  const auto said_of = [&](const std::vector<double>& distances) {
    std::vector<fit::RangePoint> points;
    for (const double mm : distances)
      points.push_back({mm, mm + error(mm) + 0.1 * normal(random), 0.1, 1000});
    std::string said;
    for (const std::string& sentence : fit::calibrate_range(points).identifiability) said += sentence + "\n";
    return said;
  };
  std::vector<double> sparse{200}, dense;
  for (int k = 0; k < 12; ++k) sparse.push_back(1000 + 150 * k);
  for (int k = 0; k < 55; ++k) dense.push_back(200 + 50 * k);
  CHECK_THAT(said_of(sparse), Catch::Contains("no distance was measured: there the correction is known to"));
  CHECK_THAT(said_of(sparse),
             Catch::Contains("between 18"));  // 200 mm less its error, 13 mm
  CHECK_THAT(said_of(dense), !Catch::Contains("no distance was measured"));
}

TEST_CASE(
    "samples of the nearest distance belong to a correction on both sides, and their mean stays right") {
  std::mt19937_64 random(5);
  std::normal_distribution<double> noise(0, 10);
  std::vector<fit::RangePoint> points;
  for (const double mm : {200.0, 500.0, 1000.0, 2000.0, 3000.0, 4000.0})
    points.push_back({.true_mm = mm, .measured_mm = mm + 2, .u_mm = 0.3, .intensity = 1000, .sd_mm = 10});
  const fit::Correction correction = *fit::calibrate_range(points).joint;
  CHECK(correction.range->lowest() == Approx(170));
  CHECK(correction.range->highest() == Approx(4030).margin(5));
  const fit::Correction read = fit::parse_correction(fit::to_json_text(correction));
  double sum = 0, inside = 0;
  for (int i = 0; i < 20'000; ++i) {
    const auto corrected = read.apply(202 + noise(random), 1000);
    if (!corrected.range_outside) sum += corrected.range_mm, ++inside;
  }
  CHECK(inside > 0.995 * 20'000);
  CHECK(sum / inside == Approx(200).margin(0.5));
  CHECK(read.apply(150, 1000).range_outside);
}

TEST_CASE("A3 on simulated samples improves by more than the paper's 30 to 60 %, A6 by more than its 28 %") {
  std::mt19937_64 random(8);
  std::uniform_real_distribution<double> grey(0.05, 0.95);
  std::normal_distribution<double> normal;
  const auto walk = [](double counts) { return (25 - 0.012 * counts) * std::exp(-0.0016 * counts); };
  // The correction comes from its own simulated experiment.
  std::vector<fit::RangePoint> points;
  for (int i = 0; i < 12; ++i) {
    const double counts = 100 + 2300.0 * i / 11;
    points.push_back({200, 200 + walk(counts) + 0.05 * normal(random), 0.05, counts});
  }
  for (int i = 3; i <= 30; ++i) {
    const double mm = 100.0 * i, counts = 2000 / (1 + mm * mm / 9e6);
    points.push_back({mm, mm + walk(counts) + 0.003 * mm + 0.05 * normal(random), 0.05, counts});
  }
  const auto calibration = fit::calibrate_range(points);
  REQUIRE(calibration.joint);
  for (const int lag : {20, 5}) {
    std::vector<Eigen::Vector2d> before, after;
    double counts = 1000;
    for (int i = -200; i <= 200; ++i) {
      if (i % 7 == 0) counts = 2200 * grey(random);
      const double beam = i * 0.1 * M_PI / 180, truth = 1400 / std::cos(beam);
      const double range = truth + walk(counts) + 0.003 * truth + 0.3 * normal(random);
      const Eigen::Vector2d direction(-std::sin(beam), std::cos(beam));
      before.push_back(range * direction);
      after.push_back(calibration.joint->apply(range, counts).range_mm * direction);
    }
    const auto a = fit::difference_spread(before, lag), b = fit::difference_spread(after, lag);
    INFO("lag " << lag << ": " << a.sd_mm << " -> " << b.sd_mm);
    CHECK(b.sd_mm < 0.4 * a.sd_mm);
    CHECK(b.plane_high_mm < a.plane_low_mm);
  }
  // The same board from two stage angles, the lidar off the axis.
  const Eigen::Vector2d centre(-1.63, -12.65);
  std::vector<Eigen::Vector2d> scenes[2][2];
  for (int view = 0; view < 2; ++view) {
    const double stage = view * M_PI / 6;
    const Eigen::Rotation2Dd turn(stage);
    const Eigen::Vector2d origin = turn * -centre;
    for (int i = -80; i <= 80; ++i) {
      const double bearing = i * 0.25 * M_PI / 180;  // In the stage's frame: the board is at x = 1400.
      const double truth = (1400 - origin.x()) / std::cos(bearing);
      const double counts = 300 + 1500 * (std::sin(0.02 * (origin.y() + truth * std::sin(bearing))) > 0);
      const double range = truth + walk(counts) + 0.003 * truth;
      const Eigen::Vector2d direction(std::cos(bearing - stage), std::sin(bearing - stage));
      scenes[0][view].push_back(turn * (range * direction));
      scenes[1][view].push_back(turn *
                                (calibration.joint->apply(range, counts).range_mm * direction - centre));
    }
  }
  const auto before = fit::scene_distance(scenes[0][0], scenes[0][1], 60);
  const auto after = fit::scene_distance(scenes[1][0], scenes[1][1], 60);
  INFO(before.mean_mm << " -> " << after.mean_mm);
  CHECK(after.mean_mm < 0.72 * before.mean_mm);
}

}  // namespace range_calibration_test
