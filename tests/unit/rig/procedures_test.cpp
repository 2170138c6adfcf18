// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include "rig/procedure/procedure.hpp"
#include "rig/procedure/procedure_plan.hpp"

namespace procedures_test {
namespace {

const std::filesystem::path folder = std::filesystem::path(RIG_SOURCE_DIR) / "procedures";

fit::Bench bench_of(const std::string& name) {
  std::stringstream text;
  text << std::ifstream(folder / name).rdbuf();
  return fit::parse_bench(text.str(), name);
}

}  // namespace

TEST_CASE("Every procedure of the project plans on a bench that comes with it") {
  const std::map<std::string, std::string> benches = {
      {"range-intensity.yaml", "range.bench.json"},   {"range-distance.yaml", "range.bench.json"},
      {"range-ladder.yaml", "range.bench.json"},      {"range-validation.yaml", "range.bench.json"},
      {"right-angle-wall.yaml", "corner.bench.json"}, {"motion-distortion.yaml", "corner.bench.json"}};
  int seen = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".yaml") continue;
    ++seen;
    const std::string name = entry.path().filename().string();
    INFO(name);
    const auto found = benches.find(name);
    const fit::Bench bench = bench_of(found == benches.end() ? "demo.bench.json" : found->second);
    const rig::Procedure procedure = rig::read_procedure(entry.path().string());
    CHECK(procedure.name + ".yaml" == name);
    CHECK_FALSE(procedure.about.empty());
    std::vector<rig::PlannedStep> plan;
    REQUIRE_NOTHROW(plan = rig::unroll(procedure, bench));
    CHECK(plan.size() > 3);
  }
  CHECK(seen >= 8);
}

TEST_CASE("The range procedures by reflectance capture twelve surfaces once, and the first again") {
  for (const char* name : {"range-intensity.yaml", "range-ladder.yaml"}) {
    INFO(name);
    const auto scans_of_return = [&](const rig::Variables& set) {
      const rig::Procedure procedure = rig::read_procedure((folder / name).string(), set);
      long captures = 0, last_scans = 0;
      for (const auto& step : rig::unroll(procedure, bench_of("range.bench.json"))) {
        captures += step.captures;
        if (step.captures > 0) last_scans = step.scans;
      }
      CHECK(captures == 13);
      return last_scans;
    };
    CHECK(scans_of_return({}) == 5000);  // Its place is far less certain than this mean.
    CHECK(scans_of_return({{"samples", 300.0}}) == 300);
  }
}

TEST_CASE("The distance calibration asks for 97 positions of 10,000 samples, half a second apart") {
  const rig::Procedure procedure = rig::read_procedure((folder / "range-distance.yaml").string());
  long captures = 0, scans = 0;
  double seconds = 0;
  for (const auto& step : rig::unroll(procedure, bench_of("range.bench.json"))) {
    captures += step.captures;
    scans += step.scans;
    seconds += step.seconds;
  }
  CHECK(captures == 97);
  CHECK(scans == 970000);
  CHECK(seconds > 97 * 4999);
}

}  // namespace procedures_test
