// SPDX-License-Identifier: MIT
#include "rig/report/explain_procedure.hpp"

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

#include "rig/json_fields.hpp"
#include "rig/procedure/procedure_plan.hpp"
#include "rig/report/explain_report.hpp"

namespace explain_procedure_test {
namespace {

fit::Bench bench() {
  return fit::parse_bench(R"({"schema": "bench/1", "targets": [
    {"name": "board \"A\"", "from_mm": [1400, -200], "to_mm": [1400, 200], "u_mm": 1, "u_deg": 0.1, "reflectance": 0.8},
    {"name": "wall", "from_mm": [2400, -3000], "to_mm": [2400, 3000], "u_mm": 1, "u_deg": 0.1}]})");
}

}  // namespace

TEST_CASE("every experiment that can be proposed is a procedure that runs as it stands") {
  const fit::Bench b = bench();
  const rig::StageLimits limits = rig::stage_limits(b);
  const auto all = fit::explain::possible_experiments(
      b, {limits.min_deg * fit::rad_per_deg, limits.max_deg * fit::rad_per_deg});
  CHECK(all.size() >= 7);
  const bool steady = GENERATE(false, true);
  for (auto experiment : all) {
    experiment.expected = 8;
    experiment.steady = steady;
    experiment.groups = {{"warm-up"}, {"temperature", "air-index"}};
    const std::string text = rig::procedure_text(experiment, b);
    INFO(text);
    CHECK_THAT(
        text,
        Catch::Contains("Tells apart warm-up and temperature or air-index, with odds of about 3000 to one") &&
            Catch::Contains("It does not separate temperature and air-index."));
    const auto procedure = rig::parse_procedure(text, "next.yaml");
    long captures = 0;
    for (const auto& step : rig::unroll(procedure, b)) captures += step.captures;
    CHECK(captures == static_cast<long>(experiment.captures.size()));
  }
}

TEST_CASE("an experiment that leaves a chain of doubts does not promise to break it") {
  fit::explain::Experiment e;
  e.expected = 5;
  e.groups = {{"zero-offset", "range-walk", "warm-up"}};
  CHECK(rig::promise_of(e) ==
        "Narrows down which of zero-offset, range-walk and warm-up it is, with odds of about 100 to one at "
        "least between "
        "two of them if what was found so far is right.");
}

TEST_CASE("an explanation becomes a page that needs nothing else") {
  const auto explanation = nlohmann::json::parse(
      R"({"schema": "explanation/1", "verdict": "explained", "cells": 10, "samples": 100,
    "located": [{"coordinate": "beam_deg", "from": 1.0, "to": 2.0, "observable": "range-mean", "p_value": 1e-9}],
    "mechanisms": [{"mechanism": "backlash", "probability": 0.99, "parameters": {"width_deg": {"value": 0.1, "u": 0.01}},
      "says": "The stage has <play>.", "evidence": "much"}],
    "undecided_between": [["a", "b"]], "next_experiment": "next.yaml", "notes": ["one"],
    "curves": [{"coordinate": "beam_deg", "at": [1, 2], "before_mm": [3, 4], "after_mm": [0, 0], "u_mm": [1, 1]}],
    "spread_curves": [{"shows": "scatter", "unit": "mm", "observable": "range-variance", "coordinate": "incidence_deg",
      "along": "", "at": [1, 2], "recorded": [3, 4], "u": [1, 1], "before": [3, 3], "after": [3, 4]}],
    "fit": {"rms_before_mm": 4.1, "rms_after_mm": 2.2, "noise_floor_mm": 2.1, "held_out_log_likelihood_before": -1,
      "held_out_log_likelihood_after": 1, "coverage_95_before": 0.8, "coverage_95_after": 0.95}})");
  const std::string html = rig::explanation_html(explanation, "a.rig");
  CHECK(html.find("<svg") != std::string::npos);
  CHECK(html.find("&lt;play&gt;") != std::string::npos);
  CHECK(html.find("scatter (mm)") != std::string::npos);
  CHECK(html.find("angle of incidence (deg)") != std::string::npos);
  CHECK(html.find("http") == html.find("http://www.w3.org"));
  CHECK(html.find("Where they differ") != std::string::npos);
}

TEST_CASE("where nothing may be missing, no page says that something is") {
  auto explanation = nlohmann::json::parse(
      R"({"verdict": "undecided", "mechanisms": [], "undecided_between": [["nothing-missing", "range-walk"]]})");
  CHECK(rig::verdict_in_words(explanation) == "This recording does not decide whether something is missing.");
  explanation["undecided_between"][0][0] = "near-field";
  CHECK(rig::verdict_in_words(explanation).find("Something is missing") == 0);
  explanation = {{"verdict", "a later version's"}};
  CHECK(rig::verdict_in_words(explanation) == "a later version's");
}

TEST_CASE("a target that is not there is told as the bench file's fault, without figures that say nothing") {
  const auto explanation = nlohmann::json::parse(
      R"({"schema": "explanation/1", "verdict": "unknown-physics", "cells": 10, "samples": 100,
    "located": [{"coordinate": "beam_deg", "from": 1.0, "to": 2.0, "observable": "range-mean", "p_value": 1}],
    "mechanisms": [], "undecided_between": [], "next_experiment": null, "notes": [], "curves": [],
    "unknown": {"coordinate": "beam_deg", "observable": "range-mean", "describes": "hardly a beam meets it", "from": 0,
      "to": 0, "bench_error": true},
    "fit": {"rms_before_mm": 4.1, "rms_after_mm": 4.1, "noise_floor_mm": 2.1, "held_out_log_likelihood_gain": 4e-10}})");
  const std::string html = rig::explanation_html(explanation, "a.rig");
  CHECK(html.find("The bench file and the recording do not agree.") != std::string::npos);
  CHECK(html.find("no mechanism of the catalogue") == std::string::npos);
  CHECK(html.find("Where they differ") == std::string::npos);
  CHECK(html.find("log-likelihood gained") == std::string::npos);
}

}  // namespace explain_procedure_test
