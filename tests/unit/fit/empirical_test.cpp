// SPDX-License-Identifier: MIT
#include "fit/bench/empirical.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <string>

#include "fit/bench/radiometer.hpp"
#include "fit/known_mechanisms.hpp"

namespace empirical_test {

using Catch::Detail::Approx;

TEST_CASE("what was measured and has no name survives in a bench file and acts") {
  fit::Bench bench = fit::parse_bench(R"({"schema": "bench/1", "targets": [
    {"name": "board", "from_mm": [1000, -200], "to_mm": [1000, 200]}]})");
  fit::add_empirical(bench, {"beam_deg", "range_mm", "", {-10, 0, 10}, {1, 3, -1}});
  fit::add_empirical(bench, {"beam_deg", "range_mm_per_m", "", {-10, 10}, {2, 2}});
  fit::add_empirical(bench, {"along_mm", "log_intensity", "board", {-100, 100}, {0.2, 0.4}});
  fit::state_merging(bench, 700);
  fit::state_strays(bench, {true, {0.1, 0.5, 0.9}});
  const fit::Bench again = fit::parse_bench(fit::to_json_text(bench));
  const auto list = fit::known_to_be_at_work(again);
  REQUIRE(list.size() == 3);
  fit::Circumstances at;
  at.beam_rad = 5 * fit::rad_per_deg;
  at.target = 0;
  at.range_mm = 3000;
  CHECK(list[0].mechanism->act(at, {}).range_mm == Approx(1));
  CHECK(list[1].mechanism->act(at, {}).range_mm == Approx(6));
  CHECK(list[2].mechanism->act(at, {}).log_intensity == Approx(0.3));
  at.beam_rad = 40 * fit::rad_per_deg;  // nothing is known there
  at.target = 1;
  CHECK(list[0].mechanism->act(at, {}).range_mm == 0);
  CHECK(list[2].mechanism->act(at, {}).log_intensity == 0);
  CHECK(fit::described_merging(again) == 700);
  CHECK(fit::described_strays(again)->range_mm(0.25, 1000) == Approx(300));
}

TEST_CASE("an empirical function covers its places and what lies between close ones, and no gap") {
  const fit::EmpiricalFunction few{"stage_deg", "range_mm", "", {-60, 0, 60}, {1, 2, 3}};
  CHECK(few.covers(-60 - 1e-9));  // the mean of a run of equal places is rounded
  CHECK(few.covers(0));
  CHECK_FALSE(few.covers(20));
  CHECK_FALSE(few.covers(70));
  CHECK_FALSE(few.covers(std::nan("")));
  const fit::EmpiricalFunction close{"beam_deg", "range_mm", "", {-10, -8, -6, 6, 10}, {1, 2, 3, 4, 5}};
  CHECK(close.covers(-7));
  CHECK_FALSE(close.covers(0));
}

TEST_CASE("a mechanism of one target must say which, and an empirical function one that is there") {
  const auto demanded = [](const std::string& more) {
    fit::demand_catalogued(fit::parse_bench(R"({"schema": "bench/1", "targets": [
      {"name": "board", "from_mm": [1000, -200], "to_mm": [1000, 200]}], )" +
                                            more + "}"));
  };
  CHECK_THROWS_WITH(
      demanded(
          R"("known": [{"mechanism": "target-tilt", "parameters": {"tilt_deg": {"value": 1, "u": 0}}}])"),
      Catch::Contains("target-tilt is of one target: say of which"));
  CHECK_THROWS_WITH(
      demanded(
          R"("empirical": [{"coordinate": "along_mm", "target": "bord", "at": [0, 1], "range_mm": [1, 2]}])"),
      Catch::Contains("is of the target \"bord\"") && Catch::Contains("board"));
}

TEST_CASE("an empirical function that is none is refused with a reason") {
  const auto functions = [](const char* entry) {
    return fit::empirical_functions(
        fit::parse_bench(std::string(R"({"schema": "bench/1", "empirical": [)") + entry + "]}"));
  };
  CHECK_THROWS_AS(functions(R"({"coordinate": "colour", "at": [1], "range_mm": [1]})"),
                  std::invalid_argument);
  CHECK_THROWS_AS(functions(R"({"coordinate": "beam_deg", "at": [2, 1], "range_mm": [1, 1]})"),
                  std::invalid_argument);
  CHECK_THROWS_AS(functions(R"({"coordinate": "beam_deg", "at": [1], "range_mm": ["x"]})"),
                  std::invalid_argument);
  CHECK_THROWS_AS(functions(R"({"coordinate": "beam_deg", "at": [1]})"), std::invalid_argument);
}

TEST_CASE("the strength of echoes is described in the bench file and read back") {
  fit::Bench bench = fit::parse_bench(R"({"schema": "bench/1"})");
  CHECK_FALSE(fit::described_intensity(bench));
  fit::DescribedIntensity described;
  described.law.value = {6.5, 1.1, 0.6, 0.5, 4.2, 7.5};
  described.surfaces.push_back({"board", 0.2, 1.05});
  fit::describe_intensity(bench, described);
  const auto read = fit::described_intensity(fit::parse_bench(fit::to_json_text(bench)));
  REQUIRE(read);
  CHECK(read->law.counts(0.2, 0.9, 1500) == Approx(described.law.counts(0.2, 0.9, 1500)));
  CHECK(read->gain("board", 0.2) == Approx(1.05));
  CHECK(read->gain("board", 0.4) == 1);
}

}  // namespace empirical_test
