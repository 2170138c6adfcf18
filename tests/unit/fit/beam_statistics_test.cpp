// SPDX-License-Identifier: MIT
#include "fit/range/beam_statistics.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <random>

namespace beam_statistics_test {
namespace {

/// The same by the textbook, two passes over one beam's ranges.
struct Textbook {
  long n = 0;
  double mean = 0, variance = 0, correlation = 0;

  explicit Textbook(const std::vector<double>& x) : n(static_cast<long>(x.size())) {
    const auto count = static_cast<double>(n);
    for (const double v : x) mean += v / count;
    for (const double v : x) variance += (v - mean) * (v - mean) / (count - 1);
    // About the first range, as an estimate in one pass has it: differs from a centred one by its ends only.
    double product = 0;
    for (std::size_t i = 1; i < x.size(); ++i) product += (x[i] - x[0]) * (x[i - 1] - x[0]) / (count - 1);
    correlation = variance > 0 ? (product - (mean - x[0]) * (mean - x[0])) / variance : 0;
  }
};

}  // namespace

TEST_CASE("statistics of beams are those of the textbook, dropouts and far ranges included") {
  constexpr std::size_t beams = 1081;
  constexpr int scans = 300;
  std::mt19937 random(1);
  fit::BeamStatistics statistics(beams);
  std::vector<std::vector<double>> kept(beams);
  std::vector<std::uint16_t> range(beams + 3);
  for (int i = 0; i < scans; ++i) {
    for (std::size_t k = 0; k < range.size(); ++k) {
      const std::uint32_t base = k % 3 == 0 ? 65400 : k % 3 == 1 ? 30000 : 60;
      range[k] = random() % 7 == 0 ? std::uint16_t{0} : static_cast<std::uint16_t>(base + random() % 130);
      if (k < beams && range[k] != 0) kept[k].push_back(range[k]);
    }
    statistics.add(range);
  }
  REQUIRE(statistics.scans() == scans);
  for (std::size_t k = 0; k < beams; ++k) {
    const Textbook expected(kept[k]);
    REQUIRE(statistics.count(k) == expected.n);
    REQUIRE(statistics.mean_mm(k) == Approx(expected.mean).epsilon(1e-12));
    REQUIRE(statistics.variance_mm2(k) == Approx(expected.variance).epsilon(1e-10));
    REQUIRE(statistics.correlation(k) == Approx(expected.correlation).margin(1e-9));
  }
}

TEST_CASE("statistics of long captures at the farthest range stay exact") {
  fit::BeamStatistics statistics(2);
  for (int i = 0; i < 200'000; ++i) {
    const std::vector<std::uint16_t> range{static_cast<std::uint16_t>(i % 2 == 0 ? 65534 : 65535), 0};
    statistics.add(range);
  }
  CHECK(statistics.mean_mm(0) == 65534.5);
  CHECK(statistics.variance_mm2(0) == Approx(0.25 * 200'000 / 199'999).epsilon(1e-12));
  CHECK(statistics.correlation(0) == Approx(-1).epsilon(1e-4));
  CHECK(statistics.count(1) == 0);
}

TEST_CASE("statistics of beams do not depend on how far ranges jump, when beams begin or where scans end") {
  constexpr std::size_t beams = 53;
  std::mt19937 random(2);
  fit::BeamStatistics statistics(beams);
  std::vector<std::vector<double>> kept(beams);
  for (int i = 0; i < 75; ++i) {
    std::vector<std::uint16_t> range(i % 11 == 0 ? beams - 20 : beams);  // some scans are shorter
    for (std::size_t k = 0; k < range.size(); ++k) {
      const bool far = k < 16 ? i >= 40 : k % 3 == 0;  // of the first beams in the third block only
      const bool begun = k % 5 != 0 || i > 20;
      if (begun && random() % 4 != 0)
        range[k] = static_cast<std::uint16_t>(far ? 1 + random() % 65535 : 20000 + random() % 8000);
      if (range[k] != 0) kept[k].push_back(range[k]);
    }
    statistics.add(range);
    for (std::size_t k = 0; k < beams; ++k) {
      const Textbook expected(kept[k]);
      REQUIRE(statistics.count(k) == expected.n);
      if (expected.n < 2) continue;
      REQUIRE(statistics.mean_mm(k) == Approx(expected.mean).epsilon(1e-12));
      REQUIRE(statistics.variance_mm2(k) == Approx(expected.variance).epsilon(1e-10).margin(1e-9));
      REQUIRE(statistics.correlation(k) == Approx(expected.correlation).margin(1e-8));
    }
  }
}

}  // namespace beam_statistics_test
