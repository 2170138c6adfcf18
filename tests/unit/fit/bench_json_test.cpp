// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>

#include "fit/bench/bench.hpp"
#include "fit/bench/json_position.hpp"

namespace bench_json_test {
namespace {

const std::string example = R"j({
  "schema": "bench/1", // the operator's knowledge
  "lidar": {"steps": 1081, "front_step": 540, "step_deg": 0.25, "scan_hz": 40,
            "mount": {"x_mm": {"value": 1, "u": 3}, "y_mm": -2, "yaw_deg": {"value": 90, "u": 0.3}}},
  "stage": {"resolution_deg": 0.01, "language": "zaber"},
  "targets": [
    {"name": "board", "from_mm": [1400, -200], "to_mm": [1400, 200], "u_mm": 1.0, "u_deg": 0.1, "reflectance": 0.85, "colour": "white"}
  ],
  "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": {"value": 8, "u": 1}}},
            {"mechanism": "subsurface", "parameters": {"offset_mm": 2, "target": "board"}}]
})j";

std::string complaint_of(const std::string& text) {
  try {
    fit::parse_bench_file(text, "b.json");
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

std::string example_with(const std::string& from, const std::string& to) {
  std::string text = example;
  return text.replace(text.find(from), from.size(), to);
}

}  // namespace

TEST_CASE("a bench file is read with its uncertainties, angles in radians") {
  const fit::Bench bench = fit::parse_bench(example);
  CHECK(bench.lidar.mount.x_mm == fit::Estimate{1, 3});
  CHECK(bench.lidar.mount.y_mm == fit::Estimate{-2, 0});
  CHECK(bench.lidar.mount.yaw_rad.value == Approx(fit::pi / 2));
  REQUIRE(bench.target("board") != nullptr);
  CHECK(bench.target("board")->outward_normal().x() == Approx(1));
  CHECK(bench.knows("range-noise")->parameters.at("sigma_mm") == fit::Estimate{8, 1});
  CHECK(bench.knows("subsurface")->texts.at("target") == "board");
}

TEST_CASE("a bench written back reads the same and loses nothing it does not know") {
  const fit::Bench bench = fit::parse_bench(example);
  const std::string text = fit::to_json_text(bench);
  CHECK(text.find("\"zaber\"") != std::string::npos);
  CHECK(text.find("\"white\"") != std::string::npos);
  const fit::Bench again = fit::parse_bench(text);
  CHECK(again.lidar.mount.yaw_rad.value == Approx(bench.lidar.mount.yaw_rad.value));
  CHECK(again.knows("subsurface")->texts.at("target") == "board");
  CHECK(again.targets.size() == 1);
}

TEST_CASE("soft limits that are not understood are refused: the stage would have none") {
  const auto with_stage = [](const std::string& stage) {
    return complaint_of(R"({"schema": "bench/1", "stage": {)" + stage + "}}");
  };
  using Catch::Contains;
  for (const char* wrong : {"-170", "[-170]", "[-170, 0, 170]", "\"-170 to 170\""})
    CHECK_THAT(with_stage(R"("limits_deg": )" + std::string(wrong)),
               Contains("must be two angles [from, to]"));
  CHECK_THAT(with_stage(R"("limits_deg": ["-170", "170"])"), Contains("must be a number"));
  CHECK_THAT(with_stage(R"("limits_deg": [170, -170])"), Contains("with from below to, not [170,-170]"));
  CHECK_THAT(with_stage(R"("limits_deg": [-1e308, 1e308])"), Contains("must lie between"));
  CHECK_THAT(with_stage(R"("limit_deg": [-170, 170])"), Contains("did you mean \"limits_deg\"?"));
  CHECK_THAT(with_stage(R"("speed_deg_s": 0)"), Contains("must lie between"));
  for (const auto& [written, key] : {std::pair(R"("limits_rad": [-0.3, 0.3])", "limits_deg"),
                                     std::pair(R"("speed_rad_s": 0.3)", "speed_deg_s")})
    CHECK_THAT(with_stage(written), Contains("in another unit") && Contains(key));
  CHECK_THAT(complaint_of(R"({"schema": "bench/1", "lidar": {"scan_hertz": 40}})"), Contains("\"scan_hz\""));
  CHECK(with_stage(R"("limits_deg": [-170, 170], "speed_deg_s": 20, "play_deg": 0.2)").empty());
  // Of the simulated stage; near to keys of the driver's.
  CHECK(with_stage(R"("language": "gsc", "axes": 1, "homed": true, "acknowledges": true)").empty());
}

TEST_CASE("a wrong bench file is refused with place, expectation and remedy") {
  CHECK(complaint_of("{").find("b.json:1:") == 0);
  CHECK(complaint_of(R"({"lidar": {}})").find("\"schema\": \"bench/1\" is missing") != std::string::npos);
  CHECK(complaint_of(example_with("bench/1", "bench/9")).find("b.json:2:13: \"schema\" says \"bench/9\"") ==
        0);
  CHECK(
      complaint_of(example_with("\"reflectance\"", "\"refletance\"")).find("did you mean \"reflectance\"?") !=
      std::string::npos);
  CHECK(complaint_of(example_with("\"u_mm\": 1.0", "\"u_mm\": -1.0"))
            .find("b.json:7:78: \"targets/0/u_mm\" is -1.0 but must lie between") == 0);
  CHECK(complaint_of(example_with("[1400, 200]", "[1400, -200]")).find("has no length") != std::string::npos);
  CHECK(complaint_of(example_with("\"steps\": 1081", "\"steps\": 10.5")).find("whole number") !=
        std::string::npos);
  CHECK(complaint_of(example_with("\"value\": 1,", "\"value\": \"1\",")).find("must be a number") !=
        std::string::npos);
  // Under another name the uncertainty would be none.
  for (const char* name : {"u_mm", "U", "sigma", "uncertainty"})
    CHECK(complaint_of(example_with("\"value\": 1, \"u\"", std::string("\"value\": 1, \"") + name + "\""))
              .find("u being the standard uncertainty") != std::string::npos);
}

TEST_CASE("slips in what the certificate prints are refused as anywhere in a bench file") {
  const auto with = [](const std::string& certificate) {
    return complaint_of(example_with("\"known\":", "\"certificate\": {" + certificate + "}, \"known\":"));
  };
  CHECK(
      with(
          R"("laboratory": "X", "received": "2026-05-12", "item_state": "", "environment": {"temperature_c": 23.5},
               "equipment": [{"name": "rule", "due": "2027-01"}], "room": "B 12")")
          .empty());
  CHECK_THAT(with(R"("labratory": "X")"), Catch::Contains("did you mean \"laboratory\"?"));
  CHECK_THAT(with(R"("authorized_by": "X")"), Catch::Contains("did you mean \"authorised_by\"?"));
  CHECK_THAT(with(R"("environment": {"temprature_c": 23})"),
             Catch::Contains("did you mean \"temperature_c\"?"));
  CHECK_THAT(with(R"("environment": {"humidity_percent": 450})"), Catch::Contains("between 0.0 and 100.0"));
  CHECK_THAT(with(R"("equipment": {"name": "rule"})"), Catch::Contains("must be a list"));
  CHECK_THAT(with(R"("equipment": [{"nam": "rule"}])"), Catch::Contains("did you mean \"name\"?"));
  CHECK_THAT(with(R"("received": "12.05.2026")"), Catch::Contains("YYYY-MM-DD"));
  CHECK(with(R"("received": "")").empty());
  CHECK_THAT(with(R"("laboratory": 7)"), Catch::Contains("must be text"));
}

TEST_CASE("a bench file in another encoding than UTF-8 is refused with the place and the remedy") {
  CHECK_THROWS_WITH(fit::parse_bench("{\"schema\": \"bench/1\",\n \"note\": \"M\xFCller\"}", "b.json"),
                    Catch::Matchers::StartsWith("b.json:2:12: ") && Catch::Matchers::Contains("UTF-8") &&
                        Catch::Matchers::Contains("iconv"));
}

TEST_CASE("a key that is given twice, and a file without content, are refused") {
  CHECK(complaint_of(
            "{\"schema\": \"bench/1\",\n \"lidar\": {}, // \"lidar\": \n \"lidar\": {\"steps\": 10}}") ==
        "b.json:3:2: this key is given twice; remove one");
  CHECK(complaint_of(example_with("\"reflectance\": 0.85", "\"name\": \"x\"")).find("b.json:7:") == 0);
  CHECK(complaint_of(" \n") == "b.json is empty");
  CHECK_THAT(complaint_of("targets: []"), Catch::Contains("A bench file is JSON"));
}

}  // namespace bench_json_test
