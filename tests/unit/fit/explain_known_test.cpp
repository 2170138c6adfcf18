// SPDX-License-Identifier: MIT
// What the bench file knows, with its uncertainty, is nothing that is missing; what receivers hide is said.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "fit/explain/explanation.hpp"
#include "fit/explain/reading.hpp"
#include "fit/known_mechanisms.hpp"
#include "plain_scenes.hpp"

namespace explain_known_test {

using fit::Estimate;
using fit::explain::to_text;
using namespace plain_bench;

/// A recording whose bench file knows one mechanism more.
class Knowing final : public fit::Forwarded {
 public:
  Knowing(const fit::Recording& of, const std::string& mechanism,
          const std::map<std::string, Estimate>& parameters)
      : Forwarded(of), bench_(of.bench()) {
    fit::add_known(bench_, fit::as_known(*fit::find_mechanism(mechanism), parameters));
  }
  const fit::Bench& bench() const override { return bench_; }

 private:
  fit::Bench bench_;
};

PlainScene furnished_room() {
  PlainScene scene{furnished};
  scene.sigma_mm = 3;
  return scene;
}

fit::explain::Explanation explained_knowing(SyntheticRecording recording, const std::string& mechanism,
                                            const std::map<std::string, Estimate>& parameters) {
  turn_round(recording, furnished_room(), 14, 25);
  const Knowing knowing(recording, mechanism, parameters);
  return fit::explain::explain({&knowing}, {});
}

TEST_CASE("a law of noise that is known to a few percent is not exact: what it leaves has no name") {
  constexpr double at_100_counts_mm = 15, u = 0.05;
  const double stated = GENERATE(1 - u, 1.0, 1 + u);
  const Spoil more_when_weak = [](const Sample& sample, std::mt19937& random) {
    const double counts = 3e6 * std::cos(sample.incidence_rad) / sample.range_mm;
    std::normal_distribution<double> noise(0, at_100_counts_mm * std::sqrt(100 / counts));
    return sample.range_mm + noise(random);
  };
  const auto e = explained_knowing(
      recorded(
          furnished_room(), 3, [](double, double, double) { return Deviation{}; }, more_when_weak),
      "intensity-noise",
      {{"sigma_mm_at_100_counts", {stated * at_100_counts_mm, u * at_100_counts_mm}}, {"exponent", {1, u}}});
  INFO("stated " << stated << " of the truth: " << to_text(e));
  CHECK(e.verdict == "nothing-missing");
}

TEST_CASE("angles that are known to scatter from scan to scan scatter by chance in few scans") {
  constexpr double sigma_deg = 0.08;
  for (const unsigned seed : {1u, 2u}) {
    const auto angle_of_scan = [seed](double time_s) {
      std::seed_seq scan{seed, static_cast<unsigned>(std::lround(time_s * 1000))};
      std::mt19937 random(scan);
      Deviation off;
      off.beam_rad = sigma_deg * degree * std::normal_distribution<double>()(random);
      return off;
    };
    const auto e = explained_knowing(
        recorded(furnished_room(), seed,
                 [&](double, double, double time_s) { return angle_of_scan(time_s); }),
        "angle-jitter", {{"sigma_deg", {sigma_deg, 0.1 * sigma_deg}}, {"own_share", {0, 0}}});
    INFO("seed " << seed << ": " << to_text(e));
    CHECK(e.verdict == "nothing-missing");
  }
}

TEST_CASE("a beam that is stated as wide may time all its light, at corners and at free edges", "[long]") {
  const bool in_a_room = GENERATE(true, false);
  PlainScene scene{in_a_room ? std::vector<Wall>{{{3200, -2100}, {3200, 1400}},
                                                 {{3200, 1400}, {-2300, 1800}},
                                                 {{-2300, 1800}, {-2300, -2100}},
                                                 {{-2300, -2100}, {3200, -2100}}}
                             : std::vector<Wall>{{{3000, -900}, {4200, 900}},
                                                 {{800, 3600}, {-900, 4700}},
                                                 {{-3900, 700}, {-2900, -900}},
                                                 {{-700, -3300}, {1200, -4300}}}};
  scene.sigma_mm = 2;
  scene.u_sigma_mm = 0.1;
  scene.u_mm = scene.u_mount_mm = 0.1;  // corners and edges are where the light is averaged
  scene.u_deg = scene.u_yaw_deg = 0.01;
  SyntheticRecording recording = recorded(scene, 9, mean_over_beam(scene, 0.3));
  turn_round(recording, scene, 14, 40);
  const Knowing knowing(recording, "mixed-pixel", {{"width_deg", {0.3, 0.03}}});
  const auto e = fit::explain::explain({&knowing}, {});
  INFO((in_a_room ? "room: " : "boards: ") << to_text(e));
  CHECK(e.verdict == "nothing-missing");
}

/// A recording whose counts end there.
class Clipped final : public fit::Forwarded {
 public:
  Clipped(const fit::Recording& of, std::uint16_t most) : Forwarded(of), most_(most) {}
  void for_each_scan(std::size_t index,
                     const std::function<void(const fit::ScanView&)>& visit) const override {
    Forwarded::for_each_scan(index, [&](fit::ScanView view) {
      std::vector<std::uint16_t> counts(view.intensity.begin(), view.intensity.end());
      for (std::uint16_t& one : counts) one = std::min(one, most_);
      view.intensity = counts;
      visit(view);
    });
  }

 private:
  std::uint16_t most_;
};

TEST_CASE("where counts end whatever comes back, the answer says so beside what it names") {
  SyntheticRecording recording = recorded(
      furnished_room(), 4, [](double, double, double) { return Deviation{}; },
      [](const Sample& sample, std::mt19937&) { return 1.004 * sample.range_mm; });
  turn_round(recording, furnished_room());
  const auto note_of = [](const fit::Recording& one) {
    for (const std::string& note : fit::explain::explain({&one}, {}).notes)
      if (note.starts_with("Counts end at")) return note;
    return std::string();
  };
  CHECK(note_of(recording).empty());
  CHECK_THAT(note_of(Clipped(recording, 1000)), Catch::StartsWith("Counts end at 1000: "));
}

TEST_CASE("where counts have ended, echoes are as strong as distance and incidence make them") {
  constexpr double end_of_counts = 1000;
  SyntheticRecording recording =
      recorded(furnished_room(), 5, [](double, double, double) { return Deviation{}; });
  turn_round(recording, furnished_room());
  const Clipped clipped(recording, end_of_counts);
  const fit::explain::Reduced reduced = fit::explain::Reading({&clipped}, {}).take_reduced();
  int beyond = 0;
  for (const fit::explain::Cell& cell : reduced.cells) {
    if (!cell.usable || cell.counts < end_of_counts) continue;
    const double counts = 3e6 * cell.at.cos_incidence / cell.at.range_mm;
    if (counts < 1.2 * end_of_counts) continue;
    ++beyond;
    CHECK(cell.at.intensity == Approx(counts).epsilon(0.05));
  }
  CHECK(beyond > 100);
}

}  // namespace explain_known_test
