// SPDX-License-Identifier: MIT
#include "sim/model_engine.hpp"

#include <catch2/catch.hpp>
#include <fstream>

#include "causal_support.hpp"
#include "fit/mechanism.hpp"
#include "sim/engine_factory.hpp"

namespace model_engine_test {

using namespace causal_test;
using Catch::Detail::Approx;

namespace {

fit::Bench bench_of(const std::vector<Board>& boards, std::vector<fit::KnownMechanism> known = {}) {
  fit::Bench bench = narrow(world_of(boards)).bench;
  bench.known = std::move(known);
  fit::KnownMechanism noise;
  noise.mechanism = "range-noise";
  noise.parameters["sigma_mm"] = {1.0};
  bench.known.push_back(noise);
  return bench;
}

fit::KnownMechanism known(const std::string& id, std::map<std::string, double> values,
                          const std::string& target = "") {
  fit::KnownMechanism one;
  one.mechanism = id;
  for (const auto& [name, value] : values) one.parameters[name] = {value};
  if (!target.empty()) one.texts["target"] = target;
  return one;
}

/// Meets the beam at 0 deg at 2400 mm.
const std::vector<Board> slant{{"wall", 3000, -1500, 1800, 1500, 0.8}};

Recording twin(
    const fit::Bench& bench, int scans, const sim::SceneState* state = nullptr,
    const std::function<sim::StageMoment(double)>& stage = [](double) { return sim::StageMoment{}; },
    double from_s = 0) {
  const auto engine = sim::make_model_engine(bench, 5);
  if (state) engine->set_scene(*state);
  return record_steps(*engine, bench.lidar, scans, from_s, stage);
}

/// Range to the line of `slant`: 3000 x + 1200 y = 3000 * 2400.
double wall_range(double bearing) {
  return 3000 * 2400.0 / (3000 * std::cos(bearing) + 1200 * std::sin(bearing));
}

}  // namespace

TEST_CASE("a twin without physics is geometry, noise and rounding") {
  const Recording recording = twin(bench_of(slant), 2000);
  for (const double beam : {-15., 0., 12.})
    CHECK(recording.at(beam).mean() == Approx(wall_range(beam * fit::rad_per_deg)).margin(0.1));
  CHECK(recording.at(0).sd() == Approx(std::sqrt(1 + 1 / 12.)).epsilon(0.05));
}

TEST_CASE("a known angle error sends the beam where the error says") {
  const auto plain = twin(bench_of(slant), 400);
  const auto bent = twin(
      bench_of(slant, {known("encoder-eccentricity", {{"amplitude_deg", 0.5}, {"phase_deg", 90}})}), 400);
  // Half a degree at beam 0 is two steps of a quarter degree.
  CHECK(bent.at(0).mean() == Approx(plain.at(0.5).mean()).margin(0.3));
}

TEST_CASE("a mechanism of one target leaves the others alone") {
  const std::vector<Board> two{{"left", 2000, 0, 2000, 2000}, {"right", 2000, -2000, 2000, 0}};
  const auto recording = twin(bench_of(two, {known("subsurface", {{"depth_mm", 9}}, "left")}), 400);
  CHECK(recording.at(5).mean() * std::cos(5 * fit::rad_per_deg) == Approx(2009).margin(0.3));
  CHECK(recording.at(-5).mean() * std::cos(5 * fit::rad_per_deg) == Approx(2000).margin(0.3));
}

TEST_CASE("a twin's noise has the size, the memory and the common angle that are stated") {
  const auto jittery = twin(bench_of(slant, {known("angle-jitter", {{"sigma_deg", 0.1}})}), 3000);
  const double slope = (wall_range(0.001) - wall_range(-0.001)) / 0.002;
  CHECK(jittery.at(0).sd() ==
        Approx(std::hypot(std::sqrt(1 + 1 / 12.), 0.1 * fit::rad_per_deg * slope)).epsilon(0.05));
  const auto slow = twin(bench_of(slant, {known("range-noise", {{"sigma_mm", 6}}),
                                          known("correlated-noise", {{"rho", 0.8}, {"share", 1}})}),
                         4000);
  const std::vector<double>& r = slow.at(0).ranges;
  double top = 0, bottom = 0;
  const double mean = slow.at(0).mean();
  for (std::size_t i = 1; i < r.size(); ++i) {
    top += (r[i] - mean) * (r[i - 1] - mean);
    bottom += (r[i] - mean) * (r[i] - mean);
  }
  CHECK(top / bottom == Approx(0.8).margin(0.05));
}

TEST_CASE("a wide beam sees front or back at a deep edge, and between at a shallow one") {
  const auto share_between = [](double gap) {
    const std::vector<Board> edge{{"front", 1500, -800, 1500, 0},
                                  {"back", 1500 + gap, -2000, 1500 + gap, 2000}};
    const auto recording = twin(bench_of(edge, {known("mixed-pixel", {{"width_deg", 0.4}})}), 300);
    int between = 0;
    for (const double r : recording.at(0).ranges) between += r > 1500 + 0.2 * gap && r < 1500 + 0.8 * gap;
    return between / 300.0;
  };
  CHECK(share_between(60) > 0.95);
  CHECK(share_between(1000) < 0.01);
}

TEST_CASE("a wide beam mixes ranges at the edge as a lidar off the axis sees it") {
  const std::vector<Board> edge{{"front", 1500, -800, 1500, 0}, {"back", 2500, -2000, 2500, 2000}};
  const auto recording = twin(bench_of(edge, {known("mixed-pixel", {{"width_deg", 0.3}}),
                                              known("lidar-arm", {{"x_mm", 0}, {"y_mm", 60}})}),
                              400);
  const auto share_behind = [&](double beam_deg) {
    int behind = 0;
    for (const double r : recording.at(beam_deg).ranges) behind += r > 2000;
    return behind / 400.0;
  };
  const double edge_deg = std::atan2(-60, 1500) * fit::deg_per_rad;  // -2.29 deg
  for (const double away : {-2.21, -0.21, 0.04, 0.29, 2.29})
    CHECK(share_behind(edge_deg + away) ==
          Approx(0.5 * std::erfc(-(std::round((edge_deg + away) * 4) / 4 - edge_deg) / 0.3 / std::sqrt(2.0)))
              .margin(0.08));
}

TEST_CASE("a twin loses and scatters the echoes it is told to") {
  const auto recording = twin(bench_of(slant, {known("outliers", {{"fraction", 0.05}})}), 4000);
  int far = 0;
  for (const double r : recording.at(0).ranges) far += std::abs(r - 2400) > 20;
  CHECK(far / 4000.0 == Approx(0.05).margin(0.012));
  const auto lossy = twin(bench_of(slant, {known("dropout", {{"intensity_min", 1e6}, {"width", 10}})}), 10);
  CHECK(lossy.at(0).lost == 10);
}

TEST_CASE("a twin knows from which side the stage came, and how long ago it stopped") {
  fit::Bench bench = bench_of(slant, {known("backlash", {{"width_deg", 1}})});
  const auto from = [&](double sign) {
    const auto stage = [sign](double t) {
      return t < 0.5 ? sim::StageMoment{sign * 0.2 * (t - 0.5), sign * 0.2} : sim::StageMoment{};
    };
    const auto engine = sim::make_model_engine(bench, 5);
    record_steps(*engine, bench.lidar, 5, 0, stage);
    return record_steps(*engine, bench.lidar, 200, 1, stage).at(0).mean();
  };
  CHECK(from(1) == Approx(twin(bench_of(slant), 200).at(-0.5).mean()).margin(0.4));
  CHECK(from(-1) == Approx(twin(bench_of(slant), 200).at(0.5).mean()).margin(0.4));
}

TEST_CASE("a twin that is switched off and on warms up again") {
  const fit::Bench bench = bench_of(slant, {known("warm-up", {{"amplitude_mm", 20}, {"tau_s", 600}})});
  const auto engine = sim::make_model_engine(bench, 5);
  const auto still = [](double) { return sim::StageMoment{}; };
  const auto at = [&](double time) {
    return record_steps(*engine, bench.lidar, 300, time, still).at(0).mean() - wall_range(0);
  };
  CHECK(at(9000) == Approx(20).margin(0.5));
  engine->switched_on(10000);
  CHECK(at(10000) == Approx(0).margin(0.5));
  CHECK(at(10600) == Approx(20 * (1 - std::exp(-1))).margin(0.5));
}

TEST_CASE("scans of a turning stage are skewed only if the bench knows motion skew") {
  const auto stage = [](double t) { return sim::StageMoment{0.5 * t, 0.5}; };
  const fit::Bench bench = bench_of(slant), rolling = bench_of(slant, {known("motion-skew", {{"share", 1}})});
  const double late = bench.lidar.beam_time_s(160) * 0.5 * fit::deg_per_rad;
  const auto at = [&](const fit::Bench& b) { return twin(b, 1, nullptr, stage).at(20).mean(); };
  const auto still = twin(bench, 200);
  CHECK(at(bench) == Approx(still.at(20).mean()).margin(4));
  CHECK(at(rolling) - at(bench) == Approx((still.at(20).mean() - still.at(19).mean()) * late).margin(5));
}

TEST_CASE("every mechanism of the catalogue can be loaded and served") {
  for (const fit::Mechanism& mechanism : fit::catalogue()) {
    INFO(mechanism.id);
    std::map<std::string, double> values;
    for (const fit::Parameter& p : mechanism.parameters)
      values[p.name] = p.role == fit::Parameter::Role::shape ? (p.lower + p.upper) / 2 : p.typical;
    const fit::Bench bench =
        bench_of(slant, {known(mechanism.id, values, mechanism.one_target ? "wall" : "")});
    const auto recording = twin(bench, 3);
    CHECK(recording.cells.size() == 161);
  }
}

TEST_CASE("what a twin cannot do is refused with the nearest name") {
  CHECK_THROWS_WITH(sim::make_model_engine(bench_of(slant, {known("range-wlak", {})}), 1),
                    Catch::Contains("did you mean 'range-walk'"));
  CHECK_THROWS_WITH(sim::make_model_engine(bench_of(slant, {known("subsurface", {}, "door")}), 1),
                    Catch::Contains("\"door\""));
  // A parameter by another name would leave the right one at its default.
  CHECK_THROWS_WITH(
      sim::make_model_engine(
          bench_of(slant, {known("range-walk", {{"amplitude_mm", 30}, {"scale_counts", 500}})}), 1),
      Catch::Contains("\"scale_counts\"") && Catch::Contains("intensity_scale"));
  CHECK_NOTHROW(sim::make_model_engine(
      bench_of(slant, {known("range-walk", {{"amplitude_mm", 30}, {"intensity_scale", 500}})}), 1));
}

TEST_CASE("the files choose the engine") {
  const auto engine_of = [](const fit::Bench& bench) {
    const std::string path = std::string(RIG_BINARY_DIR) + "/engine-choice.bench.json";
    std::ofstream(path) << fit::to_json_text(bench);
    sim::EngineChoice choice;
    choice.bench_file = path;
    return sim::make_simulated_bench(choice).engine_name;
  };
  CHECK(engine_of(bench_of(slant)) == "simple");
  CHECK(engine_of(bench_of(slant, {known("zero-offset", {{"offset_mm", 3}})})) == "model");
  CHECK_THROWS_WITH(sim::make_simulated_bench({}), Catch::Contains("--bench"));
}

}  // namespace model_engine_test
