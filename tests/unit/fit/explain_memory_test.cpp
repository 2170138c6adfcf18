// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "fit/bench/bench.hpp"
#include "fit/explain/model/mean_model.hpp"
#include "fit/recording.hpp"
#include "noise_findings.hpp"
#include "tests/support/rounds.hpp"

namespace explain_memory_test {
namespace {

using fit::explain::Found;

/// One part of a beam's noise: so much of the variance, remembered from scan to scan.
struct Part {
  double share, rho;
};

/// A lidar that looks at a wall for a while, a few times, and whose noise remembers: every part is drawn as
/// the random walk back to zero that it is.
class RememberingWall : public fit::Recording {
 public:
  /// `first`: captures that remember; `scan_mm`: of a range that every scan draws anew for all its beams.
  RememberingWall(std::vector<Part> parts, int scans, unsigned seed, std::size_t first = 99,
                  double scan_mm = 0)
      : parts_(std::move(parts)), scans_(scans), seed_(seed), first_(first), scan_mm_(scan_mm) {
    bench_ = fit::parse_bench(R"({"schema": "bench/1", "lidar": {"steps": 161, "front_step": 80,
      "step_deg": 0.25, "scan_hz": 40}, "targets": [{"name": "wall", "from_mm": [1500, -900],
      "to_mm": [1500, 900], "u_mm": 3}]})");
    for (int i = 0; i < 4; ++i) {
      fit::CaptureInfo info;
      info.id = i + 1;
      info.last_step = 160;
      info.started_us = 60'000'000LL * i;
      captures_.push_back(info);
    }
  }
  [[nodiscard]] const fit::Bench& bench() const override { return bench_; }
  [[nodiscard]] const std::vector<fit::CaptureInfo>& captures() const override { return captures_; }
  [[nodiscard]] const std::vector<fit::TrackPose>& track() const override { return track_; }
  void for_each_scan(std::size_t index,
                     const std::function<void(const fit::ScanView&)>& visit) const override {
    std::mt19937 random(seed_ * 100 + static_cast<unsigned>(index));
    std::normal_distribution<double> normal;
    constexpr double sigma_mm = 4;
    std::vector<std::vector<double>> kept(parts_.size(), std::vector<double>(161));
    for (auto& part : kept)
      for (double& value : part) value = normal(random);
    double white = 1;
    for (const Part& part : parts_) white -= part.share;
    std::vector<std::uint16_t> range(161);
    for (int seq = 0; seq < scans_; ++seq) {
      const double of_scan_mm = scan_mm_ > 0 ? scan_mm_ * normal(random) : 0;
      for (std::size_t beam = 0; beam < range.size(); ++beam) {
        double noise = std::sqrt(white) * normal(random);
        for (std::size_t p = 0; p < parts_.size(); ++p) {
          const double rho = index < first_ ? parts_[p].rho : 0;
          double& value = kept[p][beam];
          if (seq > 0) value = rho * value + std::sqrt(1 - rho * rho) * normal(random);
          noise += std::sqrt(parts_[p].share) * value;
        }
        const double slant = (static_cast<double>(beam) - 80) * 0.25 * fit::rad_per_deg;
        range[beam] =
            static_cast<std::uint16_t>(std::lround(1500 / std::cos(slant) + sigma_mm * noise + of_scan_mm));
      }
      fit::ScanView scan;
      scan.seq = seq;
      scan.host_us = captures_[index].started_us + 25000LL * seq;
      scan.device_ms = scan.host_us / 1000;
      scan.range_mm = range;
      visit(scan);
    }
  }

 private:
  std::vector<Part> parts_;
  int scans_;
  unsigned seed_;
  std::size_t first_;
  double scan_mm_;
  fit::Bench bench_;
  std::vector<fit::CaptureInfo> captures_;
  std::vector<fit::TrackPose> track_;
};

NoiseFindings spread_of(std::vector<Part> parts, int scans, unsigned seed, std::size_t first = 99,
                        double scan_mm = 0) {
  const RememberingWall wall(std::move(parts), scans, seed, first, scan_mm);
  return NoiseFindings(wall);
}

const Found* memory_in(const NoiseFindings& result) {
  for (const Found& s : result.accepted)
    if (s.mechanism->id == "correlated-noise") return &s;
  return nullptr;
}

}  // namespace

TEST_CASE("noise that fades slowly is seen at shares that neighbouring scans hardly show", "[rounds]") {
  // It lasts 20 scans, and neighbours correlate by less than 0.009, or 0.02.
  int seen = 0, hardly_seen = 0, all = 0;
  for (unsigned seed = 1; seed <= rounds(10); ++seed, ++all) {
    const NoiseFindings weaker = spread_of({{0.009, 0.95}}, 150, seed),
                        result = spread_of({{0.02, 0.95}}, 150, seed);
    hardly_seen += memory_in(weaker) != nullptr;
    seen += memory_in(result) != nullptr;
    CHECK(weaker.accepted.size() <= 1);
    CHECK(result.accepted.size() <= 1);
  }
  CHECK(hardly_seen >= least_successes(all, 0.8));
  CHECK(seen >= least_successes(all, 0.99));
}

TEST_CASE("noise without memory is not said to have one", "[rounds]") {
  int accused = 0, all = 0;
  for (unsigned seed = 1; seed <= rounds(60); ++seed, ++all) {
    const NoiseFindings result = spread_of({}, seed % 2 == 0 ? 150 : 12, seed);
    accused += memory_in(result) != nullptr;
  }
  CHECK(all - accused >= least_successes(all, 0.995));
}

TEST_CASE("how much noise remembers, and for how long, lies within what is stated", "[rounds]") {
  struct Truth {
    double rho, share;
  };
  int inside_rho = 0, inside_share = 0, nothing_else = 0, all = 0;
  for (const Truth truth : {Truth{0.5, 0.3}, {0.8, 0.2}, {0.95, 0.3}, {0.3, 0.5}})
    for (unsigned seed = 1; seed <= rounds(20); ++seed) {
      const NoiseFindings result = spread_of({{truth.share, truth.rho}}, 150, seed);
      const Found* found = memory_in(result);
      REQUIRE(found);
      const fit::Estimate rho = found->parameters.at("rho"), share = found->parameters.at("share");
      // A millimetre's rounding adds a half of a per cent of white noise.
      inside_rho += std::abs(rho.value - truth.rho) < 1.96 * rho.u;
      inside_share += std::abs(share.value - truth.share / (1 + 1.0 / 12 / 16)) < 1.96 * share.u;
      nothing_else += result.unknown.empty();
      ++all;
    }
  CHECK(nothing_else >= least_successes(all, 0.99));
  INFO(inside_rho << " and " << inside_share << " of " << all);
  CHECK(inside_rho >= least_successes(all, 0.95));
  CHECK(inside_share >= least_successes(all, 0.95));
}

TEST_CASE("what one capture remembers and the others do not is no correlated noise", "[rounds]") {
  for (unsigned seed = 1; seed <= rounds(5); ++seed) {
    const NoiseFindings result = spread_of({{0.8, 0.9}}, 150, seed, 1);
    INFO(result.in_words());
    CHECK_FALSE(memory_in(result));
    REQUIRE(result.unknown.size() == 1);
  }
}

TEST_CASE("ranges that every scan draws anew for all its beams are not said to be remembered") {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const NoiseFindings result = spread_of({}, 150, seed, 99, 1.5);
    INFO(result.in_words());
    CHECK_FALSE(memory_in(result));
    REQUIRE(result.unknown.size() == 1);
    CHECK_THAT(result.unknown.front().describes, Catch::Contains("range that a whole scan has in common"));
  }
}

}  // namespace explain_memory_test
