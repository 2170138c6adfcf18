// SPDX-License-Identifier: MIT
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>
#include <vector>

#include "fit/explain/explanation.hpp"
#include "plain_room.hpp"
#include "tests/support/rounds.hpp"

namespace explain_incidence_test {
namespace {

using fit::explain::Explanation;
using plain_bench::degree;

const std::vector<double> greys{0.9, 0.25, 0.6, 0.4};

/// A light spot that widens with the distance; it may be longer one way, and turns with the mirror then.
struct Spot {
  double long_mrad = 0, short_mrad = 0;  ///< Standard widths.
  double threshold = 0;  ///< Over the peak of a narrow beam's pulse; 0: half of whatever peak comes.
  [[nodiscard]] double width_rad(double beam_rad) const {
    return 1e-3 * std::hypot(long_mrad * std::cos(beam_rad), short_mrad * std::sin(beam_rad));
  }
};

/// Sums the pulses of 41 rays, each as late as its piece of the wall is far away, and tells by how much the
/// sum reaches the threshold earlier than the pulse of a narrow beam does.
double late_mm(const Spot& spot, double beam_rad, double range_mm, double incidence_rad) {
  constexpr double pulse_mm = 70;
  std::vector<std::pair<double, double>> rays;  // weight, farther by
  for (int k = -20; k <= 20; ++k) {
    const double off = 0.15 * k, angle = off * spot.width_rad(beam_rad);
    rays.emplace_back(std::exp(-0.5 * off * off),
                      range_mm * (std::cos(incidence_rad) / std::cos(incidence_rad + angle) - 1));
  }
  const auto signal = [&](double x) {
    double sum = 0;
    for (const auto& [weight, farther] : rays)
      sum += weight * std::exp(-0.5 * std::pow((x - farther) / pulse_mm, 2));
    return sum;
  };
  double peak = 0, all = 0;
  for (double x = -40; x <= 40; x += 0.5) peak = std::max(peak, signal(x));
  for (const auto& [weight, farther] : rays) all += weight;
  const double share = spot.threshold > 0 ? spot.threshold : 0.5,
               level = spot.threshold > 0 ? std::min(share * all, 0.99 * peak) : share * peak;
  double low = -400, high = 0;
  for (int i = 0; i < 40; ++i) {
    const double middle = (low + high) / 2;
    (signal(middle) < level ? low : high) = middle;
  }
  return low + pulse_mm * std::sqrt(2 * std::log(1 / share));
}

struct Sample {
  double range_mm = 0, counts = 0;
};

/// All beams of a scan without noise. The receiver compresses: counts go with the root of the light.
std::vector<Sample> scan_of(const std::vector<plain_bench::Wall>& walls, const Spot& spot, double stage_rad) {
  std::vector<Sample> scan;
  for (int k = -135; k <= 135; ++k) {
    const auto met = plain_bench::look(walls, {}, stage_rad, k * degree);
    scan.push_back({met->range_mm + late_mm(spot, k * degree, met->range_mm, met->incidence_rad),
                    1.2e6 / met->range_mm * std::sqrt(greys[met->wall] * std::cos(met->incidence_rad))});
  }
  return scan;
}

/// Four walls, which have greys of their own, seen all round.
Explanation explained(const std::vector<plain_bench::Wall>& walls, const Spot& spot, unsigned seed) {
  const fit::Bench bench = plain_bench::bench_of_walls(
      walls, R"("steps": 271, "front_step": 135, "step_deg": 1, "mount": {"x_mm": {"value": 0, "u": 2},
    "y_mm": {"value": 0, "u": 2}, "yaw_deg": {"value": 0, "u": 0.3}})",
      R"({"value": 3, "u": 0.3})");
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 3);
  std::vector<Sample> exact;
  SyntheticRecording recording(
      bench, [&](const fit::CaptureInfo& capture, std::int64_t seq, auto& range, auto& intensity) {
        if (seq == 0) exact = scan_of(walls, spot, capture.stage_rad);
        for (std::size_t k = 0; k < range.size(); ++k) {
          range[k] = static_cast<std::uint16_t>(std::lround(exact[k].range_mm + noise(random)));
          intensity[k] = static_cast<std::uint16_t>(std::lround(exact[k].counts));
        }
      });
  plain_bench::record_all_round(recording);
  return fit::explain::explain({&recording}, {});
}

const std::vector<plain_bench::Wall> corridor{{{5800, -900}, {5800, 850}},
                                              {{5800, 850}, {-4100, 850}},
                                              {{-4100, 850}, {-4100, -900}},
                                              {{-4100, -900}, {5800, -900}}};

}  // namespace

TEST_CASE(
    "a pulse stretched by slanted walls is told as that, be the spot round or long and turning with the "
    "mirror",
    "[rounds]") {
  const Spot spot = GENERATE(from_range(some_of<Spot>({{3, 3}, {5, 5}, {6, 1}})));
  const Explanation e = explained(plain_bench::room, spot, 1);
  INFO(to_text(e));
  CHECK_FALSE(e.unknown);
  if (!e.undecided_between.empty()) {
    // On a wall, stray light from farther aside than a narrow spot reaches is a wider spot.
    CHECK(spot.long_mrad == 3);
    std::vector<std::vector<std::string>> sets = e.undecided_between;
    for (auto& set : sets) std::ranges::sort(set);
    CHECK(sets == std::vector<std::vector<std::string>>{{"crosstalk", "incidence-bias"}});
    return;
  }
  REQUIRE(e.mechanisms.size() == 1);
  const auto& found = e.mechanisms.front();
  CHECK(found.mechanism->id == "incidence-bias");
  CHECK(found.probability > 0.9);
  CHECK(found.parameters.at("divergence").value > 0.5);
  const fit::Estimate side = found.parameters.at("width_at_side");
  CHECK(std::abs(side.value - spot.short_mrad / spot.long_mrad) < 3 * side.u);
}

TEST_CASE("where a corridor's far walls hardly reach a threshold, what their slant does bends back",
          "[rounds][long]") {
  const Explanation e =
      explained(corridor, GENERATE(from_range(some_of<Spot>({{5, 5, 0.4}, {3, 3, 0.4}}))), 2);
  INFO(to_text(e));
  CHECK_FALSE(e.unknown);
  if (e.mechanisms.empty()) {
    // Stray light from farther aside than the spot reaches is a wider spot. Walls known to a tenth of a
    // millimetre hardly tell slant from weakness, which go together in a corridor.
    REQUIRE(e.undecided_between.size() == 1);
    const std::vector<std::string>& set = e.undecided_between.front();
    CHECK(std::ranges::count(set, "incidence-bias") == 1);
    for (const std::string& one : set)
      CHECK((one == "incidence-bias" || one == "crosstalk" || one == "range-walk"));
    return;
  }
  CHECK(e.undecided_between.empty());
  REQUIRE(e.mechanisms.size() == 1);
  CHECK(e.mechanisms.front().mechanism->id == "incidence-bias");
}

}  // namespace explain_incidence_test
