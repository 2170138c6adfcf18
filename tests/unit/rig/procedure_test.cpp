// SPDX-License-Identifier: MIT
#include "rig/procedure/procedure.hpp"

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "rig/procedure/procedure_plan.hpp"

namespace procedure_test {

using Catch::Matchers::Contains;
using Catch::Matchers::StartsWith;
using rig::parse_procedure;
using rig::Unknown;
using rig::Value;

namespace {

const std::string head = "procedure: test\nsteps:\n";

fit::Bench bench() {
  fit::Bench result;
  fit::Target board;
  board.name = "board";
  board.from_mm = {1400, -200};
  board.to_mm = {1400, 200};
  result.targets = {board};
  result.document = R"({"stage": {"limits_deg": [-170, 170], "speed_deg_s": 20}})";
  return result;
}

std::vector<rig::PlannedStep> planned(const std::string& steps) {
  // The plan points into the procedure, which must live as long.
  static std::vector<std::unique_ptr<rig::Procedure>> kept;
  kept.push_back(std::make_unique<rig::Procedure>(parse_procedure(head + steps, "p.yaml")));
  return rig::unroll(*kept.back(), bench());
}

}  // namespace

TEST_CASE("expressions are calculated as on paper") {
  const rig::Variables variables = {
      {"a", 3.0}, {"far", 1500.0}, {"word", std::string("board")}, {"later", Unknown{}}};
  const auto number = [&](const char* text) { return std::get<double>(rig::evaluate_text(text, variables)); };
  CHECK(number("${1 + 2 * 3}") == 7);
  CHECK(number("${(1 + 2) * a - -4 / 2}") == 11);
  CHECK(number("${max(a, 10) + abs(0 - 2) + round(1.6)}") == 14);
  CHECK(number("0.25") == 0.25);
  CHECK(std::get<std::string>(rig::evaluate_text("${word}", variables)) == "board");
  CHECK(std::get<std::string>(rig::evaluate_text("at ${far - 200} mm", variables)) == "at 1300 mm");
  CHECK(std::holds_alternative<Unknown>(rig::evaluate_text("${later + 1}", variables)));
  CHECK(std::get<std::string>(rig::evaluate_text("plain", variables)) == "plain");
}

TEST_CASE("expressions that cannot be calculated say why") {
  const auto evaluate = [](const char* text) {
    return rig::evaluate_text(text, {{"distance", 1.0}, {"word", std::string("x")}});
  };
  CHECK_THROWS_WITH(evaluate("${distanse}"), Contains("did you mean 'distance'"));
  CHECK_THROWS_WITH(evaluate("${1 / 0}"), Contains("finite"));
  CHECK_THROWS_WITH(evaluate("${1 +"), Contains("'}' is missing"));
  CHECK_THROWS_WITH(evaluate("${1 +}"), Contains("ends where"));
  CHECK_THROWS_WITH(evaluate("${word * 2}"), Contains("only numbers"));
  CHECK_THROWS_WITH(evaluate(("${" + std::string(1000, '(') + "}").c_str()), Contains("too deeply"));
}

TEST_CASE("a wrong procedure is reported by file, line, column and remedy") {
  const auto refuse = [](const std::string& text) {
    try {
      (void)parse_procedure(text, "p.yaml");
    } catch (const rig::ProcedureError& error) {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  CHECK_THAT(refuse(head + "  - capture: {sampels: 10}\n"),
             StartsWith("p.yaml:3:15: ") && Contains("did you mean 'samples'?"));
  CHECK_THAT(refuse(head + "  - captur: {samples: 10}\n"),
             StartsWith("p.yaml:3:5: ") && Contains("did you mean 'capture'?"));
  CHECK_THAT(refuse(head + "  - capture: {samples: ten}\n"),
             StartsWith("p.yaml:3:24: ") && Contains("whole number"));
  CHECK_THAT(refuse(head + "  - capture: {samples: 0}\n"), Contains("at least 1"));
  CHECK_THAT(refuse(head + "  - capture: {samples: 1.5}\n"), Contains("whole number"));
  CHECK_THAT(refuse(head + "  - capture: {}\n"), Contains("needs 'samples'"));
  CHECK_THAT(refuse(head + "  - move: {to_deg: '${edge_dig + 1}'}\n"),
             Contains("p.yaml:3:") && Contains("edge_dig"));
  CHECK_THAT(refuse(head + "  - move: {to_deg: 1, approach: positiv}\n"),
             Contains("did you mean 'positive'?") || Contains("Did you mean 'positive'?"));
  CHECK_THAT(refuse("procedure: x\nstep: []\n"), Contains("did you mean 'steps'?"));
  CHECK_THAT(refuse("procedure: x\n"), Contains("'steps' is missing"));
  CHECK_THAT(refuse("procedure: x\nsteps: [home, {home: , home: }]\n"), Contains("given twice"));
  CHECK_THAT(refuse("procedure: [\n"), Contains("not YAML"));
  CHECK_THROWS_WITH(parse_procedure(" {\"schema\": \"bench/1\", // a bench\n \"lidar\": {}}", "b.json"),
                    Contains("is a bench file"));
  CHECK_THAT(refuse(head + "  - report: {file: ../../etc/passwd}\n"), Contains("inside the output folder"));
  CHECK_THAT(refuse(head + "  - report: {file: /etc/passwd}\n"), Contains("inside the output folder"));
  CHECK_THAT(refuse(head + "  - for-each: {x: []}\n    steps: [home]\n"), Contains("for-each"));
  CHECK_THAT(refuse(head + "  - for-each: {x: {from: 1, to: 0, step: 1}}\n    steps: [home]\n"),
             Contains("empty"));
  CHECK_THAT(refuse(head + "  - home\nlimits:\n  - {name: w, of: centre, max: 1}\n"), Contains("KIND.VALUE"));
  const std::string limit = head + "  - home\nlimits:\n  - {name: w, of: centre.x, min: 5, max: ";
  CHECK_THAT(refuse(limit + "1}\n"), Contains("p.yaml:5:") && Contains("are the wrong way round"));
  CHECK_THAT(refuse(limit + "6, guard_band: 1}\n"), Contains("none between their guard bands"));
}

TEST_CASE("a name may be used only after the step that gives it its value") {
  CHECK_THROWS_WITH(planned("  - home\n  - move: {to_deg: '${edge_deg}'}\n"),
                    Contains("there is no variable 'edge_deg'"));
  CHECK_NOTHROW(planned(
      "  - home\n  - find-edge: {target: board, beam_deg: 0}\n  - move: {to_deg: '${edge_deg + 1}'}\n"));
}

TEST_CASE("aliases cannot blow a file up") {
  std::string text = head + "  - home\nvariables:\n  a: &a [x,x,x,x,x,x,x,x,x,x]\n";
  for (char c = 'b'; c < 'j'; ++c) {
    const std::string before = std::string("*") + static_cast<char>(c - 1);
    text += std::string("  ") + c + ": &" + c + " [";
    for (int i = 0; i < 10; ++i) text += (i ? "," : "") + before;
    text += "]\n";
  }
  CHECK_THROWS_WITH(parse_procedure(text, "bomb.yaml"), Contains("aliases"));
}

TEST_CASE("loops are unrolled with every turn's own key") {
  const auto plan = planned(
      "  - home\n"
      "  - for-each: {distance_mm: {from: 200, to: 400, step: 100}, name: [a, b]}\n"
      "    steps:\n"
      "      - prompt: {title: 'Put it at ${distance_mm} mm', place: {target: board, at_mm: "
      "'${distance_mm}'}}\n"
      "      - capture: {samples: 10}\n");
  REQUIRE(plan.size() == 13);
  CHECK(plan[1].key == "2.1[distance_mm=200][name=a]");
  CHECK(plan[12].key == "2.2[distance_mm=400][name=b]");
  CHECK(plan[1].says == "prompt: Put it at 200 mm");
}

TEST_CASE("a range is counted, so its last value is exact") {
  const auto plan = planned(
      "  - home\n  - for-each: {a: {from: 0, to: 36, step: 0.01}}\n    steps: [{move: {to_deg: '${a}'}}]\n");
  REQUIRE(plan.size() == 3602);
  CHECK(std::get<double>(plan.back().loop_variables.at("a")) == 36.0);
}

TEST_CASE("what the bench forbids is found before anything moves") {
  CHECK_THROWS_WITH(planned("  - home\n  - move: {to_deg: 171}\n"),
                    Contains("p.yaml:4:") && Contains("soft limits"));
  CHECK_THROWS_WITH(planned("  - move: {to_deg: 1}\n"), Contains("before it is homed"));
  CHECK_THROWS_WITH(planned("  - home\n  - sweep: {start_deg: 165, stop_deg: 175, samples: 1}\n"),
                    Contains("soft limits"));
  CHECK_THROWS_WITH(planned("  - capture: {samples: 1, target: bord}\n"), Contains("did you mean 'board'?"));
  CHECK_THROWS_WITH(planned("  - capture: {samples: 1, beams_deg: [-140, 0]}\n"),
                    Contains("the lidar sees from -135"));
  CHECK_THROWS_WITH(planned("  - prompt: {title: x, place: {target: wall}}\n"), Contains("no target 'wall'"));
}

TEST_CASE("the dry run tells steps, travel, time and limits") {
  const auto procedure =
      parse_procedure(head +
                          "  - home\n  - sweep: {start_deg: 1, stop_deg: 2, samples: 1000}\n"
                          "limits:\n  - {name: Window, of: sensitivity.window_deg, max: 0.1}\n",
                      "p.yaml");
  const auto text = rig::dry_run_text(procedure, bench(), rig::unroll(procedure, bench()));
  CHECK_THAT(text, Contains("sweep 1 to 2 deg, 101 stops of 1000 scans"));
  CHECK_THAT(text, Contains("101,000 scans"));
  CHECK_THAT(text, Contains("Window (sensitivity.window_deg): at most 0.1"));
  CHECK_THAT(text, Contains("-170 to 170"));
}

TEST_CASE("what only the run will know makes the estimate a lower bound, and no nonsense") {
  const std::string ask = "  - home\n  - prompt: {title: x, ask: {name: later}}\n";
  const auto estimate = [&](const std::string& step) {
    const auto procedure = parse_procedure(head + ask + step, "p.yaml");
    const auto plan = rig::unroll(procedure, bench());
    for (const auto& each : plan) {
      CHECK(std::isfinite(each.seconds));
      CHECK(std::isfinite(each.travel_deg));
    }
    CHECK(plan.back().at_least);
    return rig::dry_run_text(procedure, bench(), plan);
  };
  for (const std::string step :
       {"wait: {seconds: '${later}'}", "capture: {samples: 5, spacing_s: '${later}'}",
        "capture: {samples: '${later}'}", "turn: {rate_deg_s: '${later}', from_deg: 0, samples: 50}",
        "turn: {rate_deg_s: 1, from_deg: '${later}', samples: 50, spacing_s: '${later}'}",
        "find-edge: {target: board, beam_deg: 0, near_deg: '${later}'}",
        "find-edge: {target: board, beam_deg: '${later}'}",
        "sweep: {start_deg: 0, stop_deg: '${later}', samples: 5}",
        "sweep: {start_deg: 0, stop_deg: 1, step_deg: '${later}', samples: 5}"}) {
    CAPTURE(step);
    CHECK_THAT(estimate("  - " + step + "\n"), Contains("at least ") && !Contains("nan"));
  }
  const auto known = parse_procedure(head + "  - wait: {seconds: 5}\n", "p.yaml");
  CHECK_THAT(rig::dry_run_text(known, bench(), rig::unroll(known, bench())), Contains("about "));
}

TEST_CASE("the way from an edge that the run finds to the next one is counted") {
  const std::string search = "  - find-edge: {target: board, samples: 10, beam_deg: ";
  const auto plan =
      planned("  - home\n" + search + "0}\n  - move: {to_deg: '${edge_smooth_deg}'}\n" + search + "90}\n");
  CHECK(plan.back().travel_deg > 90);
  CHECK_THAT(plan.back().says, Contains("about 16 stops (at most 19) of 10 scans"));
}

TEST_CASE("a turn is planned with the spacing of its samples") {
  const auto plan = planned("  - home\n  - turn: {rate_deg_s: 1, from_deg: 0, samples: 100, spacing_s: 1}\n");
  CHECK(plan.back().seconds > 100);
  CHECK(plan.back().travel_deg == Approx(101).margin(0.01));
  CHECK_THROWS_WITH(planned("  - home\n  - turn: {rate_deg_s: 2, from_deg: 0, samples: 100, spacing_s: 1}\n"),
                    Contains("turning would end near 202 deg"));
}

TEST_CASE("command-line variables replace the file's and nothing else") {
  const std::string text =
      "procedure: x\nvariables: {samples: 10000}\nsteps:\n  - capture: {samples: '${samples}'}\n";
  const auto procedure = parse_procedure(text, "p.yaml", {{"samples", 5.0}});
  CHECK(rig::unroll(procedure, bench()).front().scans == 5);
  CHECK_THROWS_WITH(parse_procedure(text, "p.yaml", {{"sample", 5.0}}), Contains("did you mean 'samples'?"));
}

TEST_CASE("a variable given on the command line is reported with its value and what is expected") {
  const std::string text =
      "procedure: x\nvariables: {samples: 10000, dark: false, board: b}\nsteps:\n"
      "  - capture: {samples: '${samples}'}\n";
  const auto with = [&](const std::string& name, const rig::Value& value) {
    return [&, name, value] { (void)parse_procedure(text, "p.yaml", {{name, value}}); };
  };
  CHECK_THROWS_WITH(with("samples", std::string("abc"))(),
                    "--set samples=abc: 'samples' must be a number, not 'abc'. The procedure's own is "
                    "samples=10000.");
  CHECK_THROWS_WITH(with("dark", 3.0)(), Contains("--set dark=3") && Contains("true or false"));
  CHECK_THROWS_WITH(with("sample", 5.0)(), Contains("--set sample=5") && Contains("did you mean"));
  CHECK_NOTHROW(with("board", 5.0)());
  CHECK_THROWS_WITH(with("samples", -5.0)(), Contains("p.yaml:4:") && Contains("at least 1") &&
                                                 Contains("not '-5'") && Contains("${samples} gives") &&
                                                 Contains("--set"));
}

TEST_CASE("numbers are reported without a zero's sign and without digits that mean nothing") {
  CHECK(rig::to_text(-0.0) == "0");
  CHECK(rig::rounded_text(-0.00001, 4) == "0");
  CHECK(rig::rounded_text(10.0000651041667, 4) == "10.0001");
  CHECK(rig::rounded_text(1400, 1) == "1400");
}

TEST_CASE("the schema that editors use is the one the checks use") {
  const auto path = std::filesystem::path(RIG_SOURCE_DIR) / "procedures" / "procedure.schema.json";
  if (std::getenv("RIG_UPDATE_SCHEMA")) std::ofstream(path) << rig::procedure_schema();
  std::stringstream text;
  text << std::ifstream(path).rdbuf();
  INFO("update it with RIG_UPDATE_SCHEMA=1 test_rig \"the schema*\"");
  CHECK(text.str() == rig::procedure_schema());
}

TEST_CASE("a for-each takes its turns from a list, or each value with each") {
  const std::string capture = "    steps: [{capture: {samples: \"${n}\"}}]\n";
  const auto keys = [](const std::vector<rig::PlannedStep>& plan) {
    std::string out;
    for (const auto& step : plan) out += step.key + " ";
    return out;
  };
  CHECK(keys(planned("  - for-each: [{n: 3, side: left}, {n: 4, side: right}]\n" + capture)) ==
        "1.1[n=3][side=left] 1.1[n=4][side=right] ");
  // A turn of the same values is another turn, not one that was done already.
  CHECK(keys(planned("  - for-each: [{n: 3}, {n: 4}, {n: 3}]\n" + capture)) ==
        "1.1[n=3] 1.1[n=4] 1.1[n=3][time 2] ");
  CHECK(keys(planned("  - for-each: {n: [3, 3, 3]}\n" + capture)) ==
        "1.1[n=3] 1.1[n=3][time 2] 1.1[n=3][time 3] ");
  CHECK(planned("  - for-each: {n: [3, 4], side: [left, right]}\n" + capture).size() == 4);
  const auto refused = [&](const std::string& turns, const char* words) {
    INFO(turns);
    CHECK_THROWS_WITH(planned("  - for-each: " + turns + "\n" + capture),
                      Contains(words) && StartsWith("p.yaml:3:"));
  };
  refused("[{n: 3}, {m: 4}]", "the first entry has no 'm'");
  refused("[{n: 3, side: left}, {n: 4}]", "this entry lacks 'side'");
  refused("[3, 4]", "an entry of a for-each is written {name: value, ...}");
  refused("[]", "or a list of entries");
}

}  // namespace procedure_test
