// SPDX-License-Identifier: MIT
// What `rig explain` once told wrongly of sessions that others made: each is remade here by plane
// trigonometry.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <nlohmann/json.hpp>

#include "fit/explain/around/around.hpp"
#include "fit/explain/explanation.hpp"
#include "fit/explain/inference/apart.hpp"
#include "plain_room.hpp"
#include "plain_scenes.hpp"
#include "tests/support/rounds.hpp"

namespace explain_honest_test {
namespace {

using fit::explain::Explanation;
using plain_bench::degree;
using plain_bench::Deviation;
using plain_bench::PlainScene;
using plain_bench::Sample;

Deviation nothing(double, double, double) { return {}; }

PlainScene room_of(double step_deg) {
  PlainScene scene{.walls = plain_bench::room};
  scene.front_step = static_cast<int>(std::lround(135 / step_deg));
  scene.steps = 2 * scene.front_step + 1;
  scene.step_deg = step_deg;
  return scene;
}

Explanation explained(const PlainScene& scene, unsigned seed, const plain_bench::Conceal& conceal,
                      const plain_bench::Spoil& spoil, int scans = 12) {
  SyntheticRecording recording = plain_bench::recorded(scene, seed, conceal, spoil);
  plain_bench::turn_round(recording, scene, 14, scans);
  return fit::explain::explain({&recording}, {});
}

bool names(const Explanation& e, const char* id) {
  return std::ranges::any_of(e.mechanisms, [&](const auto& m) { return m.mechanism->id == id; });
}
bool holds(const Explanation& e, const char* id) {
  return std::ranges::any_of(e.undecided_between,
                             [&](const auto& set) { return std::ranges::count(set, id) > 0; });
}

double strays_anywhere(const Sample& sample, std::mt19937& random) {
  std::uniform_real_distribution<double> share;
  return share(random) < 0.012 ? 60 + 9940 * share(random) : sample.range_mm;
}

}  // namespace

TEST_CASE("a stage that stops anywhere within its resolution is as its bench file says") {
  const PlainScene scene{.walls = plain_bench::furnished};
  const auto stops = [](double, double, double time_s) {
    std::mt19937 of_stop(static_cast<unsigned>(time_s / 20));
    return Deviation{.stage_rad = std::uniform_real_distribution<double>(-0.005, 0.005)(of_stop) * degree};
  };
  SyntheticRecording recording = plain_bench::recorded(scene, 21, stops);
  plain_bench::turn_round(recording, scene, 24, 60);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK(e.verdict == fit::explain::nothing_missing);
}

TEST_CASE("samples anywhere between the lidar and its farthest range are outliers, in a room of any shape") {
  const PlainScene scene = GENERATE(
      room_of(1), PlainScene{.walls = plain_bench::l_shaped, .steps = 271, .front_step = 135, .step_deg = 1});
  const Explanation e = explained(scene, 11, nothing, strays_anywhere);
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  CHECK(e.mechanisms.front().mechanism->id == "outliers");
  CHECK(e.undecided_between.empty());
  CHECK(e.mechanisms.front().parameters.at("fraction").value == Approx(0.012).epsilon(0.15));
}

TEST_CASE("outliers beside an eccentricity are both named") {
  const Explanation e = explained(
      room_of(1), 12,
      [](double beam, double, double) { return Deviation{.beam_rad = 0.2 * degree * std::sin(beam)}; },
      strays_anywhere);
  INFO(to_text(e));
  CHECK(names(e, "outliers"));
  CHECK(names(e, "encoder-eccentricity"));
  CHECK(e.mechanisms.size() == 2);
}

TEST_CASE("coarse steps of the range are told beside samples that come from anywhere") {
  constexpr double step_mm = 6.2;
  const Explanation e = explained(room_of(1), 19, nothing, [](const Sample& sample, std::mt19937& random) {
    std::uniform_real_distribution<double> share;
    return share(random) < 0.05 ? 60 + 9940 * share(random) : step_mm * std::round(sample.range_mm / step_mm);
  });
  INFO(to_text(e));
  CHECK(names(e, "outliers"));
  CHECK(names(e, "rounding"));
  CHECK(e.mechanisms.size() == 2);
  for (const auto& found : e.mechanisms)
    if (found.mechanism->id == "rounding")
      CHECK(found.parameters.at("step_mm").value == Approx(step_mm).margin(0.01));
}

TEST_CASE(
    "another scale of the range in a sector of the beams is told as that, and nothing is named for it") {
  const Explanation e = explained(room_of(1), 16, nothing, [](const Sample& sample, std::mt19937&) {
    const double beam_deg = sample.beam_rad / degree;
    return sample.range_mm * (beam_deg > 10.5 && beam_deg < 70.5 ? 1.002 : 1);
  });
  INFO(to_text(e));
  CHECK(e.mechanisms.empty());
  REQUIRE(e.unknown);
  CHECK(e.unknown->coordinate == fit::Coordinate::beam);
  CHECK_THAT(e.unknown->describes, Catch::Contains("the range's scale"));
  REQUIRE_FALSE(e.correction.empty());
  CHECK(e.correction.front().acts_on == "range_mm_per_m");
  CHECK(e.correction.front().value_at(40) - e.correction.front().value_at(-40) == Approx(2).epsilon(0.15));
}

TEST_CASE("a plain formula does not pay for what others of its cause may have besides", "[rounds][long]") {
  // In a corridor echoes get weaker as walls get more slanted: a range walk can do what they do.
  PlainScene corridor = room_of(1);
  corridor.walls = {{{-4000, -900}, {4000, -900}},
                    {{4000, -900}, {4000, 900}},
                    {{4000, 900}, {-4000, 900}},
                    {{-4000, 900}, {-4000, -900}}};
  const unsigned seed = GENERATE(from_range(some_of<unsigned>({17, 18})));
  const Explanation slanted = explained(corridor, seed, nothing, [](const Sample& sample, std::mt19937&) {
    return sample.range_mm + 0.3 * std::pow(std::tan(std::min(1.4, std::abs(sample.incidence_rad))), 2);
  });
  INFO(to_text(slanted));
  // Walls that bend by a tenth of a millimetre leave a doubt now and then.
  CHECK((names(slanted, "incidence-bias") || holds(slanted, "incidence-bias")));
  CHECK_FALSE(names(slanted, "range-walk"));
}

TEST_CASE("noise that grows as an exponential of a weakening echo is that of weak echoes") {
  const Explanation e = explained(
      room_of(1), 13, nothing,
      [](const Sample& sample, std::mt19937& random) {
        const double counts = 3e6 * std::cos(sample.incidence_rad) / sample.range_mm;
        return sample.range_mm + std::normal_distribution<double>(0, 9 * std::exp(-counts / 500))(random);
      },
      40);
  INFO(to_text(e));
  CHECK((names(e, "intensity-noise") || holds(e, "intensity-noise")));
}

TEST_CASE(
    "noise at some angles that never changes and loses no echo is told as light only beside another cause",
    "[long]") {
  const auto noisy = [](double lost) {
    return [=](const Sample& sample, std::mt19937& random) {
      const double away = (sample.beam_rad / degree - 30) / 12;
      const double more = std::exp(-away * away / 2);
      if (std::uniform_real_distribution<double>()(random) < lost * more) return 0.0;
      return sample.range_mm + std::normal_distribution<double>(0, 8 * more)(random);
    };
  };
  const Explanation e = explained(room_of(1), 14, nothing, noisy(0));
  INFO(to_text(e));
  CHECK_FALSE(names(e, "sunlight"));
  CHECK((names(e, "local-noise") || holds(e, "local-noise")));
  const Explanation bright = explained(room_of(1), 15, nothing, noisy(0.05));
  INFO(to_text(bright));
  CHECK((names(bright, "sunlight") || holds(bright, "sunlight")));
}

TEST_CASE("a placement counts once in what is gained on captures that were not fitted to") {
  PlainScene scene{.walls = {{{800, -500}, {800, 500}}},
                   .u_mm = 5,
                   .u_deg = 0.5,
                   .steps = 271,
                   .front_step = 135,
                   .step_deg = 1,
                   .sigma_mm = 3};
  const fit::Bench stated = plain_bench::bench_of(scene);
  std::string document = stated.document.json().dump();
  document.insert(document.find("\"name\""), "\"placed_anew\":true,");
  const fit::Bench bench = fit::parse_bench(document);
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  std::vector<double> off, turned;
  for (int i = 0; i < 24; ++i)
    off.push_back(5 * normal(random)), turned.push_back(0.5 * degree * normal(random));
  SyntheticRecording recording(bench, [&](const fit::CaptureInfo& info, std::int64_t, auto& range, auto&) {
    const auto place = static_cast<std::size_t>(info.id - 1);
    const double away = 800 + info.target_shift_mm + off[place];
    for (std::size_t k = 0; k < range.size(); ++k) {
      const double beam = (info.first_step + static_cast<double>(k) - 135) * degree;
      const double far = away * std::cos(turned[place]) / std::cos(beam - turned[place]);
      range[k] = static_cast<std::uint16_t>(std::lround(far + 3 * normal(random)));
    }
  });
  for (int i = 0; i < 24; ++i) {
    fit::CaptureInfo capture;
    capture.target = "wall 1";
    capture.target_shift_mm = 150 * i;
    capture.first_step = 128;
    capture.last_step = 142;
    capture.since_power_on_s = 3600 + 60 * i;
    recording.add(capture, 100);
  }
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK(e.verdict == "nothing-missing");
  CHECK(std::abs(e.after.log_likelihood - e.before.log_likelihood) < 20);
  CHECK(e.before.coverage > 0.9);
  CHECK(e.before.coverage < 0.99);
  // 24 placements, each within its uncertainty: a cell's log density is that of noise, or little less.
  CHECK(e.before.log_likelihood / e.before.cells > -1);
}

TEST_CASE("a recording without intensities is predicted by what was learnt with them, in figures") {
  const auto walk = [](const Sample& sample, std::mt19937&) {
    const double counts = 3e6 * std::cos(sample.incidence_rad) / sample.range_mm;
    return sample.range_mm + 40 * std::exp(-counts / 500);
  };
  const PlainScene scene = room_of(2);
  SyntheticRecording recording = plain_bench::recorded(scene, 16, nothing, walk);
  plain_bench::turn_round(recording, scene);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  class Dark : public fit::Forwarded {
   public:
    using Forwarded::Forwarded;
    void for_each_scan(std::size_t index,
                       const std::function<void(const fit::ScanView&)>& visit) const override {
      Forwarded::for_each_scan(index, [&](fit::ScanView scan) {
        scan.intensity = {};
        visit(scan);
      });
    }
  };
  const Dark dark(recording);
  const fit::explain::Prediction p = fit::explain::predict_recording(e.predictor, dark);
  for (const double figure :
       {p.before.rms_mm, p.before.log_likelihood, p.after.rms_mm, p.after.rms_of_means_mm,
        p.after.log_likelihood, p.after.coverage_95, p.gain, p.u_gain})
    CHECK(std::isfinite(figure));
}

TEST_CASE("what a recording is worth between suspects of noise is told by the channels in which they act") {
  using namespace fit::explain;
  const PlainScene scene = room_of(4);
  SyntheticRecording recording = plain_bench::recorded(scene, 17, nothing);
  plain_bench::turn_round(recording, scene);
  Reduced reduced = reduce(recording, {});
  pool_variances(reduced);
  Suspect memory, jitter, edges;
  memory.mechanism = fit::find_mechanism("correlated-noise");
  jitter.mechanism = fit::find_mechanism("angle-jitter");
  edges.mechanism = fit::find_mechanism("mixed-pixel");
  memory.parameters = {{"rho", {0.5, 0.1}}, {"share", {0.5, 0.1}}};
  jitter.parameters = {{"sigma_deg", {0.1, 0.01}}};
  edges.parameters = {{"width_deg", {0.1, 0.01}}};
  const Eigen::MatrixXd evidence = inference::evidence_between(reduced, {memory, jitter, edges});
  CHECK(evidence.allFinite());
  // The recording's memory tells memory from angles, which have none, and edges are no channel of theirs.
  CHECK(evidence(0, 1) > 10);
  CHECK(evidence(2, 0) == 0);
  CHECK(evidence(2, 1) == 0);
}

TEST_CASE("a flicker is found and taken off the samples' variance") {
  using namespace fit::explain;
  const PlainScene scene = room_of(2);
  SyntheticRecording recording =
      plain_bench::recorded(scene, 18, nothing, [](const Sample& sample, std::mt19937&) {
        const double since_s =
            0.025 * static_cast<double>(sample.seq) + (sample.beam_rad / degree + 135) / 360 * 0.025;
        return sample.range_mm + 8 * std::sin(2 * fit::pi * 100.7 * since_s +
                                              40 * sample.stage_rad);  // out of step with captures
      });
  for (int i = 0; i < 14; ++i) {
    fit::CaptureInfo capture;
    capture.stage_rad = (41.3 * i - 140) * degree;
    capture.last_step = scene.steps - 1;
    recording.add(capture, 60);
  }
  Reduced reduced = reduce(recording, {});
  pool_variances(reduced);
  const auto mean_variance = [&] {
    double sum = 0;
    for (const Cell& cell : reduced.cells)
      sum += cell.variance_mm2 / static_cast<double>(reduced.cells.size());
    return sum;
  };
  const double before = mean_variance();
  std::vector<Unexplained> unknown;
  const auto hz = mains::flicker(reduced, {}, {}, unknown);
  REQUIRE(hz);
  CHECK(*hz == Approx(100.7).margin(0.3));
  CHECK(unknown.size() == 1);
  mains::take_off_flicker(*hz, reduced);
  CHECK(before - mean_variance() == Approx(8 * 8 / 2.0).margin(3));
}

}  // namespace explain_honest_test
