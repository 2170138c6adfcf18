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
#include "fit/explain/model/noise_of_scans.hpp"
#include "fit/explain/model/scans.hpp"
#include "fit/explain/reduction/lag_products.hpp"
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

/// Of two parts, each with a range and an angle, in so many scans; the second part is not in every scan.
std::vector<fit::explain::model::ScanPart> ranges_and_angles(int scans) {
  std::vector<fit::explain::model::ScanPart> list;
  for (int scan = 0; scan < scans; ++scan)
    for (const int part : {0, 1})
      for (const bool of_angle : {false, true}) {
        if (part == 1 && scan % 5 == 2) continue;
        fit::explain::model::ScanPart one;
        one.scans = scans;
        one.in_capture = scan;
        one.block = 2 * part + (of_angle ? 1 : 0);
        one.of_angle = of_angle;
        one.sensitivity_mm = of_angle ? 900 : part == 0 ? 2000 : -1500;
        one.variance_mm2 = part == 0 ? 0.3 : 0.7;
        list.push_back(one);
      }
  return list;
}

TEST_CASE(
    "noise that scans share, of any memory, has the likelihood of its covariance beside blocks' means") {
  using fit::explain::model::RandomOfScans;
  const auto parts = ranges_and_angles(12);
  const auto n = static_cast<Eigen::Index>(parts.size());
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  const std::pair<RandomOfScans, RandomOfScans> cases[] = {
      {{}, {}},
      {{.fresh = 0.4}, {.fresh = 1e-7}},
      {{.slow = 0.5, .rho = 0.95}, {}},
      {{.own = 0.6, .rho = 0.8}, {.own = 0.3, .rho = 0.5}},
      {{.fresh = 0.2, .slow = 0.5, .own = 0.4, .rho = 0.9}, {.fresh = 2e-8, .slow = 1e-7, .rho = 0.7}}};
  for (const auto& [range, angle] : cases) {
    Eigen::MatrixXd covariance(n, n), means = Eigen::MatrixXd::Zero(n, 4), column(n, 1);
    for (Eigen::Index i = 0; i < n; ++i) {
      const auto& a = parts[static_cast<std::size_t>(i)];
      means(i, a.block) = 1;
      column(i, 0) = normal(random);
      for (Eigen::Index k = 0; k < n; ++k) {
        const auto& b = parts[static_cast<std::size_t>(k)];
        const int lag = std::abs(a.in_capture - b.in_capture);
        const auto shared = [&](const RandomOfScans& of) {
          return of.slow * std::pow(of.rho, lag) + (lag == 0 ? of.fresh : 0);
        };
        double both = a.sensitivity_mm * b.sensitivity_mm * shared(angle);
        if (!a.of_angle && !b.of_angle) both += shared(range);
        const RandomOfScans& of = a.of_angle ? angle : range;
        if (a.block == b.block) both += a.variance_mm2 * (i == k ? 1 : of.own * std::pow(of.rho, lag));
        covariance(i, k) = both;
      }
    }
    const Eigen::LDLT<Eigen::MatrixXd> root(covariance);
    const Eigen::MatrixXd of_means = root.solve(means);
    const Eigen::VectorXd shift = (means.transpose() * of_means).ldlt().solve(of_means.transpose() * column),
                          left = column - means * shift;
    const double expected = left.dot(root.solve(left));
    fit::explain::model::NoiseOfScans(0, parts, range, angle).whiten(column);
    INFO("range " << range.fresh << ' ' << range.slow << ' ' << range.own);
    CHECK(column.squaredNorm() == Approx(expected));
  }
}

TEST_CASE("of noise with memory what beams have each by itself is not a scan's") {
  // A hundred beams: all of it their own, or a drift of whole scans.
  for (const bool shared : {false, true}) {
    fit::explain::Reduced reduced;
    constexpr int scans = 20, beams = 100, captures = 15;
    constexpr double rho = 0.9;
    std::mt19937 random(3);
    std::normal_distribution<double> normal;
    for (int capture = 0; capture < captures; ++capture) {
      fit::explain::Group group;
      group.scans = scans;
      group.cells = beams;
      fit::explain::reduction::LagProducts products(beams);
      std::vector<double> slow(beams);
      for (double& value : slow) value = normal(random);
      std::vector<std::vector<double>> rows(scans, std::vector<double>(beams));
      for (auto& row : rows)
        for (std::size_t b = 0; b < row.size(); ++b) {
          row[b] = shared ? normal(random) : slow[b];
          slow[b] = rho * slow[b] + std::sqrt(1 - rho * rho) * normal(random);
        }
      for (std::size_t b = 0; b < beams; ++b) {
        double mean = 0;
        for (const auto& row : rows) mean += row[b] / scans;
        for (auto& row : rows) row[b] -= mean;
      }
      for (const auto& row : rows) products.add(row, group);
      reduced.groups.push_back(group);
    }
    fit::explain::model::ScatterOfScans scatter;
    scatter.variance = 0.01;
    scatter.rho = rho;
    scatter.ratio = shared ? 30 : 1;
    scatter.share = 0.95;
    const auto found = fit::explain::model::random_of_scans(reduced, scatter);
    INFO(shared);
    if (shared) {
      CHECK(found.own == 0);
      CHECK(found.slow == Approx(0.95 * 30 * 0.01));
      CHECK(found.fresh == Approx((29 - 0.95 * 30) * 0.01));
    } else {
      CHECK(found.own == Approx(0.95).margin(0.05));
      CHECK(found.slow < 0.001);
    }
  }
}

}  // namespace scan_parts_test
