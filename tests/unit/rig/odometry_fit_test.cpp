// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>

#include "rig/errors.hpp"
#include "rig/fitting/fitting.hpp"
#include "tests/support/test_folder.hpp"

namespace odometry_fit_test {
namespace {

using nlohmann::json;

/// Twenty seconds of a robot with wheels of 40 mm, 200 mm apart, lidar 50 mm ahead; as tuples of 0.1 s.
void write_run(const std::string& file, double phase, bool timed, double share = 1) {
  std::ofstream out(file);
  std::mt19937 random(static_cast<unsigned>(100 * phase + 1));
  std::normal_distribution<double> gauss;
  for (int k = 0; k < 200; ++k) {
    const double t = 0.1 * k + phase, left = 4 + 3 * std::sin(0.9 * t), right = 4 + 3 * std::cos(1.3 * t);
    const double way = 0.1 * 0.5 * 0.04 * (left + right), turn = 0.1 * share * 0.04 * (right - left) / 0.2;
    const double along = std::abs(turn) < 1e-9 ? way : way * std::sin(turn) / turn,
                 across = std::abs(turn) < 1e-9 ? 0 : way * (1 - std::cos(turn)) / turn;
    json line = {{"T", 0.1}, {"phi_l", left}, {"phi_r", right}};
    line["sm"] = {along + 0.05 * (std::cos(turn) - 1) + 0.0003 * gauss(random),
                  across + 0.05 * std::sin(turn) + 0.0003 * gauss(random), turn + 0.001 * gauss(random)};
    if (timed) line["t"] = 0.1 * k;
    out << line.dump() << "\n";
  }
}

json value_of(const json& result, const std::string& name) {
  for (const auto& value : result.at("values"))
    if (value.at("name") == name) return value;
  FAIL("no value " << name);
  return {};
}

}  // namespace

TEST_CASE("tuple files are runs: one that slipped is named and left out") {
  const TestFolder place;
  std::vector<rig::FitSource> sources;
  for (int i = 0; i < 6; ++i) {
    const std::string file = place / ("run-" + std::to_string(i) + ".tuple");
    write_run(file, 3.0 * i, true, i == 2 ? 0.8 : 1);
    sources.push_back({file, nullptr});
  }
  const json result = rig::run_fit("odometry", sources, json::object());
  CHECK_THAT(result.at("notes").dump(), Catch::Contains("run-2.tuple was left out"));
  CHECK(value_of(result, "separation_mm").at("value").get<double>() == Approx(200).margin(1));
  CHECK(value_of(result, "lidar_x_mm").at("value").get<double>() == Approx(50).margin(1));
  CHECK(std::abs(value_of(result, "time_offset_ms").at("value").get<double>()) < 10);
}

TEST_CASE("tuples of a tricycle, and such as go back in time, are told apart in words") {
  const TestFolder place;
  const std::string file = place / "run.tuple";
  write_run(file, 0, true);
  CHECK_THROWS_WITH(rig::run_fit("odometry", {{file, nullptr}}, {{"steering", "tricycle"}}),
                    Catch::Contains("\"steer\": -0.1"));
  std::ofstream(file, std::ios::app) << R"({"T": 0.1, "phi_l": 1, "phi_r": 1, "sm": [0, 0, 0], "t": 3})";
  CHECK_THROWS_WITH(rig::run_fit("odometry", {{file, nullptr}}, json::object()),
                    Catch::Contains("object 201") && Catch::Contains("t does not grow"));
}

}  // namespace odometry_fit_test
