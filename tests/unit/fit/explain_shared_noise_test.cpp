// SPDX-License-Identifier: MIT
// Noise that neighbouring beams share, made by a moving average over beams.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "fit/explain/model/neighbours.hpp"
#include "fit/explain/reduction/reduce.hpp"
#include "noise_findings.hpp"
#include "plain_room.hpp"
#include "tests/support/rounds.hpp"

namespace explain_shared_noise_test {
namespace {

using plain_bench::degree;

constexpr double sigma_mm = 5;  // of every sample, shared or not

struct Air {
  int beams_alike = 1;    ///< Over which the shared noise is averaged.
  double share = 0;       ///< Of the variance.
  double jitter_deg = 0;  ///< Of whole scans.
  int beams = 541;        ///< Around the front.
  double lost = 0;        ///< Share of echoes.
  double within_rad = 10;  ///< Of the room's front: elsewhere no noise is shared.
  unsigned seed = 1;
};

/// `count` values of unit variance; neighbours are alike.
std::vector<double> shared_values(std::size_t count, int beams_alike, std::mt19937& random) {
  std::normal_distribution<double> normal;
  const auto width = static_cast<std::size_t>(beams_alike);
  std::vector<double> white(count + width), values(count);
  for (double& v : white) v = normal(random);
  for (std::size_t k = 0; k < count; ++k) {
    for (std::size_t j = 0; j < width; ++j) values[k] += white[k + j];
    values[k] /= std::sqrt(static_cast<double>(width));
  }
  return values;
}

template <class Look>
auto look_through(const Air& air, const Look& look) {
  std::mt19937 random(air.seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> lot;
  SyntheticRecording recording(
      plain_bench::bench_of_room(R"("steps": 541, "front_step": 270, "step_deg": 0.5)",
                                 R"({"value": 5, "u": 0.25})"),
      [&](const fit::CaptureInfo& capture, std::int64_t, auto& range, auto&) {
        const double turned = air.jitter_deg * degree * normal(random);
        const std::vector<double> shared = shared_values(range.size(), air.beams_alike, random);
        for (std::size_t k = 0; k < range.size(); ++k) {
          const double beam = (capture.first_step + static_cast<double>(k) - 270) * 0.5 * degree + turned;
          const auto met = plain_bench::look(plain_bench::room, {}, capture.stage_rad, beam, {});
          const bool is_there =
              std::abs(std::remainder(capture.stage_rad + beam, 2 * fit::pi)) < air.within_rad;
          const double share = is_there ? air.share : 0,
                       noise = std::sqrt(share) * shared[k] + std::sqrt(1 - share) * normal(random);
          range[k] = static_cast<std::uint16_t>(std::lround(met->range_mm + sigma_mm * noise));
          if (air.lost > 0 && lot(random) < air.lost) range[k] = 0;
        }
      });
  for (int i = 0; i < 8; ++i) {
    fit::CaptureInfo capture;
    capture.stage_rad = 45 * i * degree;
    capture.approach = 1;
    capture.first_step = 270 - air.beams / 2;
    capture.last_step = 270 + air.beams / 2;
    capture.since_power_on_s = 600 + 40 * i;
    recording.add(capture, 40);
  }
  return look(recording);
}

NoiseFindings found_in(const Air& air) {
  return look_through(air, [](const fit::Recording& room) { return NoiseFindings(room); });
}

}  // namespace

TEST_CASE(
    "sectors of scans scatter as independent noise says, whatever whole scans do and however few beams") {
  for (const int beams : {9, 13, 541})
    for (const double jitter_deg : {0.0, 0.3}) {
      const fit::explain::Reduced reduced =
          look_through({.jitter_deg = jitter_deg, .beams = beams, .seed = 2},
                       [](const fit::Recording& room) { return fit::explain::reduce(room, {}); });
      double ratio = 0, n = 0;
      for (const auto& capture : fit::explain::model::sector_scatter(reduced, 3)) {
        ratio += capture.n * capture.square_mm2 / capture.expected_mm2;
        n += capture.n;
      }
      REQUIRE(n > 500);
      INFO("jitter of " << jitter_deg << " deg, " << beams << " beams, " << n << " degrees of freedom");
      CHECK(ratio / n == Approx(1).margin(4 * std::sqrt(2 / n)));
      if (jitter_deg == 0) CHECK(fit::explain::model::inflation_of_squares(reduced) == 1);
    }
}

TEST_CASE("noise that neighbours share before one wall makes that one's means uncertain, and no other's") {
  const fit::explain::Reduced reduced =
      look_through({.beams_alike = 12, .share = 0.5, .within_rad = 0.6, .seed = 6},
                   [](const fit::Recording& room) { return fit::explain::reduce(room, {}); });
  const std::vector<double> of_targets = fit::explain::model::inflation_of_targets(reduced);
  REQUIRE(of_targets.size() == 4);
  const auto east = static_cast<std::size_t>(
      std::ranges::find(reduced.bench.targets, "east", &fit::Target::name) - reduced.bench.targets.begin());
  // Half of the variance is independent, and a sum over twelve equal beams has twelve times that of one; from
  // -34 to 34 deg of the wall, which is seen from -36 to 53. A part of it goes for what scans have in common.
  constexpr double at_most = 1 + 5.5 * 68 / 89;
  for (std::size_t t = 0; t < of_targets.size(); ++t) {
    INFO(reduced.bench.targets[t].name << " " << of_targets[t]);
    if (t == east)
      CHECK((of_targets[t] > 0.7 * at_most && of_targets[t] < 1.1 * at_most));
    else
      CHECK(of_targets[t] == 1);
  }
}

TEST_CASE("scans of two echoes say nothing of noise that neighbours share") {
  const fit::explain::Reduced reduced =
      look_through({.beams = 41, .lost = 0.95, .seed = 5},
                   [](const fit::Recording& room) { return fit::explain::reduce(room, {}); });
  CHECK(fit::explain::model::inflation_of_squares(reduced) == 1);
  CHECK(fit::explain::model::inflation_of_sums(reduced) == 1);
}

TEST_CASE("noise that neighbouring beams share is no angle of whole scans: it is unknown", "[rounds]") {
  for (const int beams_alike : some_of<int>({4, 12, 40})) {
    const NoiseFindings found = found_in({.beams_alike = beams_alike, .share = 0.5, .seed = 3});
    INFO(beams_alike << " beams alike: " << found.in_words());
    CHECK(found.accepted.empty());
    CHECK(found.undecided.empty());
    REQUIRE(found.unknown.size() == 1);
    CHECK(found.unknown.front().describes.find("neighbouring beams") != std::string::npos);
  }
}

TEST_CASE("an angle that whole scans draw keeps its name beside noise that neighbours share",
          "[rounds][long]") {
  for (const int beams_alike : some_of<int>({12, 1})) {
    const NoiseFindings found = found_in(
        {.beams_alike = beams_alike, .share = beams_alike > 1 ? 0.5 : 0, .jitter_deg = 0.1, .seed = 4});
    INFO(beams_alike << " beams alike: " << found.in_words());
    REQUIRE(found.accepted.size() == 1);
    CHECK(found.accepted.front().mechanism->id == "angle-jitter");
    CHECK(found.unknown.empty() == (beams_alike == 1));
  }
}

}  // namespace explain_shared_noise_test
