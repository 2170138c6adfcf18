// SPDX-License-Identifier: MIT
// What whole scans have in common.
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "fit/explain/model/scans.hpp"
#include "fit/explain/reduce.hpp"
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

TEST_CASE("what whole scans remember is told from what each draws anew, and so is how their means scatter") {
  constexpr int blocks = 150, scans = 60;
  for (const double rho : {0.0, 0.4, 0.85}) {
    constexpr double remembered = 0.5;  // variance, beside 1 that is drawn anew
    std::mt19937 random(7);
    std::normal_distribution<double> normal;
    std::vector<fit::explain::model::ScanPart> parts;
    for (int block = 0; block < blocks; ++block) {
      std::vector<double> mm;
      double slow = normal(random), mean = 0;
      for (int k = 0; k < scans; ++k) {
        mm.push_back(normal(random) + (rho > 0 ? std::sqrt(remembered) * slow : 0));
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
    const auto found = fit::explain::model::scatter_of_scans(parts, false);
    const double truth = rho > 0 ? 1 + remembered * (1 + rho) / (1 - rho) : 1;
    INFO("rho " << rho << ": found " << found.rho << " of a share of " << found.share);
    CHECK((found.share > 0) == (rho > 0));
    CHECK(found.ratio * found.over_time() == Approx(truth).epsilon(0.25));
  }
}

}  // namespace scan_parts_test
