// SPDX-License-Identifier: MIT
// What whole scans have in common.
#include <Eigen/Dense>
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <iterator>
#include <random>
#include <vector>

#include "fit/explain/model/autoregression.hpp"
#include "fit/explain/model/block_means.hpp"
#include "fit/explain/model/scans.hpp"
#include "fit/explain/reduction/reduce.hpp"
#include "plain_room.hpp"

namespace scan_parts_test {

using plain_bench::degree;

TEST_CASE("what repeats is taken off captures of few and of many beams, and leaves both as it says") {
  constexpr int captures = 16, of_few_beams = 12;
  constexpr long scans = 800;
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 3);
  SyntheticRecording recording(
      plain_bench::bench_of_room(R"("steps": 271, "front_step": 135, "step_deg": 1)",
                                 R"({"value": 3, "u": 0.3})"),
      [&](const fit::CaptureInfo& capture, std::int64_t, auto& range, auto&) {
        for (std::size_t k = 0; k < range.size(); ++k) {
          const double beam = (capture.first_step + static_cast<double>(k) - 135) * degree;
          const auto met = plain_bench::look(plain_bench::room, {}, capture.stage_rad, beam, {});
          range[k] = static_cast<std::uint16_t>(std::lround(met->range_mm + noise(random)));
        }
      });
  for (int i = 0; i < captures; ++i) {
    fit::CaptureInfo capture;
    capture.stage_rad = 20 * i * degree;
    capture.approach = 1;
    capture.first_step = i < of_few_beams ? 133 : 0;
    capture.last_step = i < of_few_beams ? 137 : 270;
    capture.since_power_on_s = 100 + 40 * i;
    recording.add(capture, scans);
  }
  const fit::explain::Reduced reduced = fit::explain::reduce(recording, {});
  struct Sums {
    double squares = 0, number = 0;
  } few, many;
  for (const fit::explain::model::ScanPart& part : fit::explain::model::scan_parts(reduced, 3, 1)) {
    if (part.of_angle) continue;
    Sums& sums = part.capture < of_few_beams ? few : many;
    sums.squares += part.rest_mm * part.rest_mm / part.variance_mm2;
    sums.number += part.news;
  }
  for (const Sums& sums : {few, many}) {
    REQUIRE(sums.number > scans);
    // Five standard deviations of a mean of squares of normal values.
    CHECK(sums.squares / sums.number == Approx(1).margin(5 * std::sqrt(2 / sums.number)));
  }
}

TEST_CASE(
    "parts of scans scatter as they say before walls of unlike noise, in captures of few scans and many") {
  const double noise_mm[] = {1, 7, 2.5, 10};
  for (const long scans : {40, 200}) {
    std::mt19937 random(6);
    std::normal_distribution<double> normal;
    SyntheticRecording recording(
        plain_bench::bench_of_room(R"("steps": 271, "front_step": 135, "step_deg": 1)",
                                   R"({"value": 3, "u": 3})"),
        [&](const fit::CaptureInfo& capture, std::int64_t, auto& range, auto&) {
          for (std::size_t k = 0; k < range.size(); ++k) {
            const double beam = (static_cast<double>(k) - 135) * degree;
            const auto met = plain_bench::look(plain_bench::room, {}, capture.stage_rad, beam, {});
            range[k] = static_cast<std::uint16_t>(
                std::lround(met->range_mm + noise_mm[met->wall % std::size(noise_mm)] * normal(random)));
          }
        });
    for (int i = 0; i < 2000 / scans; ++i) {
      fit::CaptureInfo capture;
      capture.stage_rad = 23 * i * degree;
      capture.approach = 1;
      capture.last_step = 270;
      recording.add(capture, scans);
    }
    const fit::explain::Reduced reduced = fit::explain::reduce(recording, {});
    const auto parts = fit::explain::model::scan_parts(reduced, 3, 4);
    double together = 0, pairs = 0;  // the angle of a part comes after its range
    for (std::size_t i = 0; i + 1 < parts.size(); ++i)
      if (!parts[i].of_angle && parts[i + 1].of_angle) {
        together +=
            parts[i].mm * parts[i + 1].mm / std::sqrt(parts[i].variance_mm2 * parts[i + 1].variance_mm2);
        pairs += 1;
      }
    REQUIRE(pairs > 7000);
    CHECK(std::abs(together / pairs) < 0.05);
    for (const bool of_angle : {false, true}) {
      double number = 0, squares = 0, fourths = 0;
      for (const fit::explain::model::ScanPart& part : parts) {
        if (part.of_angle != of_angle) continue;
        const double square = part.mm * part.mm / part.variance_mm2 / (1 - 1.0 / static_cast<double>(scans));
        number += 1, squares += square, fourths += square * square;
      }
      INFO(scans << " scans, of the angle: " << of_angle);
      REQUIRE(number > 7000);
      CHECK(squares / number == Approx(1).margin(0.06));
      CHECK(fourths / squares == Approx(3).margin(0.35));  // as of one normal distribution
    }
  }
}

/// Captures of so many scans whose ranges scatter by 1 mm, and beside it by noise of variance `remembered`
/// with that correlation from scan to scan. Every capture is less its mean.
std::vector<fit::explain::model::ScanPart> captures_of(int captures, int scans, double rho, double remembered,
                                                       std::mt19937& random) {
  std::normal_distribution<double> normal;
  std::vector<fit::explain::model::ScanPart> parts;
  for (int block = 0; block < captures; ++block) {
    std::vector<double> mm;
    double slow = normal(random), mean = 0;
    for (int k = 0; k < scans; ++k) {
      mm.push_back(normal(random) + std::sqrt(remembered) * slow);
      mean += mm.back() / scans;
      slow = rho * slow + std::sqrt(1 - rho * rho) * normal(random);
    }
    for (const double value : mm) {
      fit::explain::model::ScanPart part;
      part.block = block;
      part.scans = scans;
      part.rest_mm = value - mean;
      part.news = 1 - 1.0 / scans;
      part.variance_mm2 = 1;
      parts.push_back(part);
    }
  }
  return parts;
}

TEST_CASE("what whole scans remember is told from what each draws anew, and so is how their means scatter") {
  constexpr int scans = 60;
  for (const double rho : {0.0, 0.4, 0.85}) {
    const double remembered = rho > 0 ? 0.5 : 0;  // variance, beside 1 that is drawn anew
    std::mt19937 random(7);
    const auto found =
        fit::explain::model::scatter_of_scans(captures_of(150, scans, rho, remembered, random), false);
    double of_means = 1 + remembered;  // by the variances of sums of so many
    for (int lag = 1; lag < scans; ++lag)
      of_means += 2 * remembered * (1 - static_cast<double>(lag) / scans) * std::pow(rho, lag);
    INFO("rho " << rho << ": found " << found.rho << " of a share of " << found.share);
    CHECK((found.share > 0) == (rho > 0));
    CHECK(found.ratio * found.more_in_means(scans) == Approx(of_means).epsilon(0.25));
  }
}

TEST_CASE("captures of few scans that remember nothing are not taken for slow noise") {
  std::mt19937 random(11);
  int remembers = 0;
  double most = 1;
  for (int session = 0; session < 500; ++session) {
    const auto found = fit::explain::model::scatter_of_scans(captures_of(52, 12, 0, 0, random), false);
    remembers += found.share > 0;
    most = std::max(most, found.more_in_means(12));
  }
  CHECK(remembers <= 5);
  CHECK(most < 2);
}

TEST_CASE("remembered noise divided out has the likelihood of its covariance, whatever its share") {
  constexpr int n = 40;
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  for (const auto& [rho, share] : {std::pair(0.9, 0.3), {0.5, 1.0}, {0.95, 0.05}, {0.0, 0.0}}) {
    Eigen::MatrixXd covariance(n, n);
    for (int i = 0; i < n; ++i)
      for (int k = 0; k < n; ++k) covariance(i, k) = i == k ? 1 : share * std::pow(rho, std::abs(i - k));
    const Eigen::LLT<Eigen::MatrixXd> root(covariance);
    Eigen::VectorXd values(n);
    for (double& value : values) value = normal(random);
    const double expected = root.matrixL().solve(values).squaredNorm();
    fit::explain::model::RememberedNoise(rho, share).whiten(values);
    INFO(rho << " of " << share);
    CHECK(values.squaredNorm() == Approx(expected));
  }
}

TEST_CASE("of rows whose noise is remembered the mean of a block says nothing") {
  fit::explain::model::BlockMeans means;
  means.weight = Eigen::VectorXd::LinSpaced(6, 1, 2);
  means.blocks = {{0, 2, 4}, {1, 3, 5}};
  means.noise = {fit::explain::model::RememberedNoise(0.8, 0.5), {}};
  Eigen::MatrixXd column = Eigen::MatrixXd::Constant(6, 1, 3.0);
  means.whiten(column);
  CHECK(column.norm() < 1e-12);
}

}  // namespace scan_parts_test
