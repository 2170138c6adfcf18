// SPDX-License-Identifier: MIT
#include "sim/world.hpp"

#include <catch2/catch.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "fit/mechanism.hpp"
#include "sim/engine_factory.hpp"

namespace world_test {
namespace {

using nlohmann::json;
const std::filesystem::path worlds = std::filesystem::path(RIG_SOURCE_DIR) / "sim/worlds";

/// What a lidar sees of a world on a tour: cold and warm, standing after moves from both sides, turning, in
/// another room temperature, with a target moved and recoloured.
std::vector<std::uint32_t> tour(const sim::World& world) {
  const auto engine = sim::make_causal_engine(world, 3);
  const auto stage = [](double t) {
    if (t < 10) return sim::StageMoment{};
    if (t < 11) return sim::StageMoment{0.4 * (t - 10), 0.4};
    if (t < 20) return sim::StageMoment{0.4, 0};
    if (t < 21) return sim::StageMoment{0.4 - 0.3 * (t - 20), -0.3};
    if (t < 30) return sim::StageMoment{0.1, 0};
    return t < 31 ? sim::StageMoment{0.1 + 0.35 * (t - 30), 0.35} : sim::StageMoment{0.45, 0};
  };
  std::vector<std::uint32_t> seen, range(1081), intensity(1081);
  const auto look = [&](double time) {
    engine->scan(time, stage, range, intensity);
    seen.insert(seen.end(), range.begin(), range.end());
    seen.insert(seen.end(), intensity.begin(), intensity.end());
  };
  for (const double time : {0.0, 0.025, 10.5, 11.1, 20.5, 21.1, 21.2, 30.5, 600.0}) look(time);
  sim::SceneState state;
  state.target = "bright board";
  state.target_shift_mm = 100;
  state.reflectance = 0.3;
  state.temperature_c = 35;
  engine->set_scene(state);
  for (const double time : {601.0, 4000.0}) look(time);
  return seen;
}

sim::World with(const std::string& parts) {
  json document = {{"schema", "world/1"},
                   {"bench",
                    {{"schema", "bench/1"},
                     {"targets", {{{"name", "wall"}, {"from_mm", {2000, -900}}, {"to_mm", {2000, 900}}}}}}}};
  document.merge_patch(json::parse(parts));
  return sim::parse_world(document.dump(1));
}

}  // namespace

TEST_CASE("every effect of the catalogue has an example world in which something else is measured") {
  json plain = {{"schema", "world/1"}, {"bench_file", "room.bench.json"}};
  const sim::World room = sim::load_world(worlds / "everything-at-once.world.json");
  sim::World nothing;
  nothing.bench = room.bench;
  const std::vector<std::uint32_t> usual = tour(nothing);
  sim::World at_once = nothing;
  at_once.rotor.rolling = false;
  const std::vector<std::uint32_t> all_at_once = tour(at_once);
  for (const fit::Mechanism& mechanism : fit::catalogue()) {
    INFO(mechanism.id);
    const std::filesystem::path file = worlds / (mechanism.id + ".world.json");
    REQUIRE(std::filesystem::exists(file));
    CHECK(tour(sim::load_world(file)) != (mechanism.id == "motion-skew" ? all_at_once : usual));
  }
}

TEST_CASE("a world without causes is read as a good device") {
  const sim::World world = with("{}");
  CHECK(world.receiver.compensation == 1);
  CHECK(world.rotor.facets.empty());
}

TEST_CASE("wrong keys and values of a world are refused with their place and the nearest name") {
  using Catch::Contains;
  CHECK_THROWS_WITH(with(R"({"rotor": {"disk_ofset": 0.1}})"),
                    Contains("did you mean \"disk_offset\"") && Contains("world:"));
  CHECK_THROWS_WITH(with(R"({"rotors": {}})"), Contains("did you mean \"rotor\""));
  CHECK_THROWS_WITH(with(R"({"receiver": {"threshold": -1}})"), Contains("threshold") && Contains("-1"));
  CHECK_THROWS_WITH(with(R"({"receiver": {"threshold": "low"}})"), Contains("must be a number"));
  CHECK_THROWS_WITH(with(R"({"pulse": {"shape": "square"}})"), Contains("raised-cosine"));
  CHECK_THROWS_WITH(with(R"({"truth": {"targets": {"wal": {}}}})"), Contains("not a target"));
  CHECK_THROWS_WITH(with(R"({"firmware": {"median": 4}})"), Contains("odd"));
  CHECK_THROWS_WITH(with(R"({"schema": "world/7"})"), Contains("world/1"));
  CHECK_THROWS_WITH(sim::parse_world("{\n  \"schema\": \"world/1\",,\n}"), Contains("world:2:"));
  CHECK_THROWS_WITH(sim::parse_world(R"({"schema": "world/1", "air": {"index_error": 1e999}})"),
                    Contains("world: holds a number that is too large"));
  CHECK_THROWS_WITH(sim::parse_world(R"({"schema": "world/1"})"), Contains("bench"));
  CHECK_THROWS_WITH(sim::load_world("/nowhere.world.json"), Contains("/nowhere.world.json"));
}

TEST_CASE("the bench file of a world says nothing of its causes") {
  sim::World world = sim::load_world(worlds / "everything-at-once.world.json");
  world.bench.document.change([](json& document) { document["stage"]["physics"] = {{"backlash_deg", 0.1}}; });
  const fit::Bench bench = fit::parse_bench(sim::compile_world(world));
  REQUIRE(bench.known.size() == 1);
  CHECK(bench.known[0].mechanism == "range-noise");
  const double sigma = bench.known[0].parameters.at("sigma_mm").value;
  CHECK(sigma > 3);
  CHECK(sigma < 30);
  CHECK(bench.lidar.mount.x_mm.value == 0);
  CHECK_FALSE(bench.document.section("stage").contains("physics"));
  CHECK(bench.targets.size() == world.bench.targets.size());
}

TEST_CASE("gear play of a world goes to the stage's simulator") {
  sim::World world = with(R"({"stage": {"play_deg": 0.2}})");
  const fit::Bench bench = sim::take_play(world);
  CHECK(world.stage.play_rad == 0);
  CHECK(bench.document.section("stage").at("physics").at("backlash_deg").get<double>() == Approx(0.2));
}

}  // namespace world_test
