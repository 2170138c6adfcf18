// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "rig/errors.hpp"
#include "rig/investigate/cost.hpp"
#include "rig/investigate/decision.hpp"
#include "rig/investigate/dossier_document.hpp"
#include "rig/investigate/investigation.hpp"
#include "rig/investigate/one_clock.hpp"
#include "rig/investigate/session_plan.hpp"
#include "rig/investigate/state.hpp"
#include "rig/procedure/procedure_plan.hpp"
#include "rig/report/dossier_page.hpp"
#include "rig/session/sha256.hpp"
#include "tests/support/test_folder.hpp"

namespace investigate_test {
namespace {

using namespace rig;
using namespace rig::investigate;
using nlohmann::json;
using Verdict = Conclusions::Verdict;

Possible possible(const std::string& title, double information, double minutes, bool needs_operator = false) {
  return {title, information, minutes, needs_operator, false};
}

/// A room with a board that can be moved.
fit::Bench room() {
  return fit::parse_bench(R"({"schema": "bench/1",
    "lidar": {"model": "UST-10LX", "steps": 1081, "front_step": 540, "step_deg": 0.25, "scan_hz": 40,
              "mount": {"x_mm": {"value": 0, "u": 3}, "y_mm": {"value": 0, "u": 3}, "yaw_deg": {"value": 0, "u": 0.3}}},
    "stage": {"resolution_deg": 0.01},
    "targets": [
      {"name": "east", "from_mm": [3000, -2000], "to_mm": [3000, 2000], "u_mm": 1.5, "u_deg": 0.1, "reflectance": 0.6},
      {"name": "north", "from_mm": [3000, 2000], "to_mm": [-2500, 2000], "u_mm": 1.5, "u_deg": 0.1, "reflectance": 0.5},
      {"name": "west", "from_mm": [-2500, 2000], "to_mm": [-2500, -2000], "u_mm": 1.5, "u_deg": 0.1, "reflectance": 0.5},
      {"name": "south", "from_mm": [-2500, -2000], "to_mm": [3000, -2000], "u_mm": 1.5, "u_deg": 0.1, "reflectance": 0.5},
      {"name": "board", "from_mm": [900, -180], "to_mm": [900, 180], "u_mm": 1, "u_deg": 0.1, "reflectance": 0.8}]})");
}

std::vector<PlannedStep> planned(const std::string& text) {
  static std::vector<Procedure> kept;  // Planned steps point into it.
  kept.reserve(100);
  kept.push_back(parse_procedure(text, "test"));
  return unroll(kept.back(), room());
}

/// What an investigation in `folder` asks of others, none of which is expected.
Investigation investigation_in(const TestFolder& folder, bool resume) {
  Options options;
  options.folder = folder / ".";
  options.resume = resume;
  return {room(), options, {}};
}

}  // namespace

TEST_CASE("an investigation removes its own half-written files, and nobody else's") {
  const TestFolder folder;
  const std::vector<std::string> own = {"bench.json.part12", "round-1.yaml.part7",
                                        "last-2.explanation.json.part3", "dossier.pdf.part9.html"},
                                 others = {"video.mp4.part", "thesis.part2", "round-one.yaml.part7",
                                           "round-1.yaml.part7.bak", "bench.json.particle"};
  for (const auto* names : {&own, &others})
    for (const std::string& name : *names) std::ofstream(folder / name) << "x";
  (void)investigation_in(folder, false);  // Nothing is known yet of whose folder it is.
  CHECK(folder.names().size() == own.size() + others.size());
  State begun;
  Sha256 hash;
  hash.feed(fit::to_json_text(room()));
  begun.bench_sha256 = hash.hex();
  std::ofstream(folder / "investigation.json") << to_json(begun).dump();
  CHECK_THROWS_AS(investigation_in(folder, false), UsageError);
  CHECK(folder.names().size() == 1 + own.size() + others.size());
  (void)investigation_in(folder, true);
  CHECK(folder.names().size() == 1 + others.size());
  for (const std::string& name : others) CHECK(std::filesystem::exists(folder / name));
}

TEST_CASE("an investigation does next what tells most per minute, not what tells most") {
  const std::vector<Possible> experiments = {possible("a long ladder", 1.0, 100),
                                             possible("a few turns", 0.5, 4)};
  const Decision d = decide({Verdict::undecided, 1}, experiments, {}, {480, false, 5});
  REQUIRE(d.next);
  CHECK(d.next->from == Decision::From::experiments);
  CHECK(d.next->index == 1);
}

TEST_CASE("an unattended investigation does nothing that needs a hand, and says that one would tell") {
  const std::vector<Possible> experiments = {possible("a ladder", 1.0, 40, true)};
  CHECK(decide({Verdict::undecided, 1}, experiments, {}, {480, false, 5}).next);
  const Decision d = decide({Verdict::undecided, 1}, experiments, {}, {480, true, 5});
  CHECK_FALSE(d.next);
  CHECK(d.end == End::undecidable);
  CHECK(d.needs == "an operator, for 40 min: a ladder");
}

TEST_CASE(
    "what takes longer than there is time left ends an investigation, and how much it takes is reported") {
  const Decision d =
      decide({Verdict::undecided, 1}, {possible("a cold start", 1.0, 190, true)}, {}, {60, false, 5});
  CHECK_FALSE(d.next);
  CHECK(d.end == End::budget_spent);
  CHECK(d.needs == "190 min: a cold start");
}

TEST_CASE("where nothing is in doubt the investigation looks where it has not looked, the quickest first") {
  const std::vector<Possible> surveys = {possible("all round", 0, 4), possible("turning", 0, 1),
                                         possible("by hand", 0, 0.5, true)};
  for (const Verdict verdict : {Verdict::nothing_missing, Verdict::explained}) {
    const Decision d = decide({verdict, 1}, {}, surveys, {480, true, 5});
    REQUIRE(d.next);
    CHECK(d.next->from == Decision::From::surveys);
    CHECK(d.next->index == 1);
  }
  std::vector<Possible> done = surveys;
  for (Possible& p : done) p.done = true;
  CHECK(decide({Verdict::nothing_missing, 1}, {}, done, {480, false, 5}).end == End::nothing_missing);
  CHECK(decide({Verdict::explained, 0.99}, {}, done, {480, false, 5}).end == End::named);
  CHECK(decide({Verdict::unknown_physics, 1}, {}, done, {480, false, 5}).end == End::unknown_physics);
}

TEST_CASE("a name of which the sessions are not sure is no end by that name") {
  CHECK(decide({Verdict::explained, 0.7}, {}, {}, {480, false, 5}).end == End::undecidable);
  CHECK(decide({Verdict::undecided, 1}, {}, {}, {480, false, 5}).end == End::undecidable);
}

TEST_CASE("a prediction is confirmed by coverage, by residuals, and by a gain where something is claimed") {
  const Outcome good{100000, 0.951, 0.94, 0.8, 0.75, 120, 15, false};
  CHECK(judge(good, true).confirmed);
  Outcome worse = good;
  worse.coverage_95 = 0.90;
  CHECK_FALSE(judge(worse, true).confirmed);
  worse = good, worse.rms_of_means_mm = 1.3;
  CHECK_FALSE(judge(worse, true).confirmed);
  worse = good, worse.gain = 20;
  CHECK_FALSE(judge(worse, true).confirmed);
  CHECK(judge(worse, false).confirmed);
  CHECK(judge(worse, false).reasons.back() == "No cause was named, so nothing was found to test.");
  worse.named_again = true;  // Coarse steps, say: no mean and no variance shows them.
  CHECK(judge(worse, true).confirmed);
  worse.gain = -100;
  CHECK_FALSE(judge(worse, true).confirmed);
}

TEST_CASE(
    "the first look of an attended investigation moves a board only where it can be seen, and puts it back") {
  const fit::Bench bench = room();
  const SessionPlan alone = first_plan(bench, {}, false), attended = first_plan(bench, {}, true);
  CHECK_FALSE(needs_operator(planned(procedure_text("alone", alone, bench))));
  const auto steps = planned(procedure_text("attended", attended, bench));
  CHECK(needs_operator(steps));
  for (const fit::CaptureInfo& c : attended.captures())
    if (c.target) CHECK(900 + c.target_shift_mm < 3000);  // before the wall
  CHECK(steps.back().says == "prompt: board: back in its place");
  std::set<int> approaches;
  for (const fit::CaptureInfo& c : alone.captures()) approaches.insert(c.approach);
  CHECK(approaches.count(1) + approaches.count(-1) == 2);
}

TEST_CASE("sessions keep to the stage's soft limits") {
  StageLimits limits;
  limits.min_deg = -20, limits.max_deg = 35;
  const fit::Bench bench = room();
  for (const SessionPlan& plan :
       {first_plan(bench, limits, false),
        fresh_plan(bench, limits, false, first_plan(bench, limits, false).captures())})
    for (const fit::CaptureInfo& c : plan.captures()) {
      CHECK(c.stage_rad * fit::deg_per_rad >= -20);
      CHECK(c.stage_rad * fit::deg_per_rad <= 35);
    }
}

TEST_CASE(
    "the predicted session is recorded from where none was recorded, and at other distances and greys") {
  const fit::Bench bench = room();
  const auto so_far = first_plan(bench, {}, true).captures();
  const auto fresh = fresh_plan(bench, {}, true, so_far).captures();
  int turned = 0, moved = 0;
  for (const fit::CaptureInfo& c : fresh) {
    (c.target ? moved : turned)++;
    for (const fit::CaptureInfo& before : so_far) {
      if (c.target != before.target) continue;
      if (!c.target) CHECK(std::abs(c.stage_rad - before.stage_rad) > fit::rad_per_deg);
      if (c.target) CHECK(std::abs(c.target_shift_mm - before.target_shift_mm) > 50);
    }
  }
  CHECK(turned == 8);
  CHECK(moved > 0);
}

TEST_CASE("a board that was moved is back in its place before anything else is looked at") {
  const fit::Bench bench = room();
  auto so_far = first_plan(bench, {}, true).captures();
  so_far.front().temperature_c = 20, so_far.back().temperature_c = 30;
  const SessionPlan fresh = fresh_plan(bench, {}, true, so_far);
  REQUIRE(fresh.captures().back().temperature_c);  // The whole scene, after the board's placements.
  bool away = false;
  for (const PlannedStep& step : planned(procedure_text("fresh", fresh, bench))) {
    if (step.says.find("prompt: board") == 0) away = step.says.find("back in its place") == std::string::npos;
    if (step.captures > 0 && away) CHECK(step.scans == 200);  // of the board alone
  }
  CHECK_FALSE(away);
}

TEST_CASE(
    "nobody has looked for a drift before a quarter of an hour has passed, nor for warmth at one "
    "temperature") {
  const fit::Bench bench = room();
  auto so_far = first_plan(bench, {}, false).captures();
  const auto titles = [&] {
    std::set<std::string> list;
    for (const SessionPlan& plan : surveys(bench, {}, so_far)) {
      list.insert(plan.title);
      CHECK_NOTHROW(planned(procedure_text("survey", plan, bench)));
    }
    return list;
  };
  CHECK(titles().count("One stage angle for a quarter of an hour") == 1);
  CHECK(titles().count("The lidar's housing at two temperatures") == 1);
  CHECK(titles().count("The stage turns at two rates, both ways") == 1);
  so_far.back().started_us = 1'000'000'000;
  so_far.front().temperature_c = 20, so_far.back().temperature_c = 30;
  so_far.front().stage_rate_rad_s = 0.1;
  CHECK(titles().count("One stage angle for a quarter of an hour") == 0);
  CHECK(titles().count("The lidar's housing at two temperatures") == 0);
  CHECK(titles().count("The stage turns at two rates, both ways") == 0);
}

TEST_CASE("walking to a target costs minutes, covering it fewer, a cold start hours") {
  const char* begin = "procedure: test\ntitle: t\nsteps:\n  - home\n";
  const auto cost = [&](const std::string& steps) { return cost_of(planned(begin + steps), {}); };
  CHECK(cost("  - capture: {samples: 100}\n").hand == 0);
  const std::string placed =
      "  - prompt: {title: a, place: {target: board, shift_mm: 200, reflectance: 0.8}}\n";
  CHECK(cost(placed).hand == Approx(move_min + cover_min));
  CHECK(cost(placed + "  - prompt: {title: b, place: {target: board, shift_mm: 200, reflectance: 0.1}}\n")
            .hand == Approx(move_min + 2 * cover_min));
  CHECK(cost("  - prompt: {title: c, place: {temperature_c: 25, since_power_on_s: 0}}\n").hand > 120);
}

TEST_CASE("between sessions the lidar's clock counts, through its wrap, unless it was switched off") {
  CHECK(passed_s(1000, 61000, 60.2) == Approx(60));
  CHECK(passed_s((1 << 24) - 5000, 5000, 10) == Approx(10));
  CHECK(passed_s(1000, 301000, 0.4) == Approx(300));     // a simulation at full speed
  CHECK(passed_s(1000000, 2000, 7200) == Approx(7200));  // it began anew meanwhile
}

TEST_CASE("the state of an investigation is read as it was written") {
  State state;
  state.bench_sha256 = "ab";
  state.budget_min = 90;
  state.on_for_min = 0;
  Round round;
  round.session.name = "round-1";
  round.session.title = "A look";
  round.session.cost = {2, 3};
  round.session.recorded = true;
  round.considered = {possible("a", 0.5, 4, true)};
  round.explanation = {{"verdict", "undecided"}};
  state.rounds = {round, round};
  state.ending = {End::budget_spent, "why", "needs", {"a look"}};
  state.last = round.session;
  state.prediction_sha256 = "cd";
  const State again = state_of(to_json(state).dump(), "investigation.json");
  CHECK(to_json(again) == to_json(state));
  CHECK(again.minutes_spent() == 15);
  CHECK_THROWS_AS(state_of("{\"schema\": \"investigation/9\"}", "investigation.json"), UsageError);
  CHECK_THROWS_AS(state_of("half a docu", "investigation.json"), UsageError);
}

TEST_CASE("a dossier claims only what the predicted recording confirmed") {
  State state;
  Round round;
  round.session.name = "round-1";
  round.explanation = {{"verdict", "explained"},
                       {"mechanisms",
                        {{{"mechanism", "backlash"},
                          {"probability", 0.99},
                          {"says", "The stage has play."},
                          {"evidence", "e"},
                          {"parameters", {{"width_deg", {{"value", 0.1}, {"u", 0.01}}}}}}}},
                       {"undecided_between", json::array()},
                       {"suspects", {{{"name", "backlash"}, {"probability", 0.99}, {"set", false}}}},
                       {"notes", json::array()}};
  state.rounds = {round};
  state.ending = {End::named, "It has a name.", "", {}};
  const auto claim = [&] { return dossier_document(state, room()).at("claim").get<std::string>(); };
  CHECK(claim().find("backlash") == std::string::npos);
  state.last = round.session;
  state.comparison = {{"confirmed", false}, {"reasons", {"Did not hold: coverage."}}};
  CHECK(claim().find("Nothing is claimed") == 0);
  state.comparison["confirmed"] = true;
  CHECK(claim().find("backlash") != std::string::npos);
  CHECK(claim().find("second prediction") == std::string::npos);
  state.refuted = 1;
  CHECK(claim().find("This was the second prediction; the first did not come true.") != std::string::npos);
  state.rounds.push_back(round);
  state.rounds.back().session.name = "round-2", state.rounds.back().session.without_data = true;
  state.rounds.back().session.failed = "There was no clock.";
  state.rounds.front().explanation["undecided_between"] =
      json::array({json::array({"angle-jitter", "nothing-missing"})});
  state.rounds.back().explanation = state.rounds.front().explanation;
  const std::string page = dossier_page(dossier_document(state, room()));
  CHECK(page.find("2 sessions,") != std::string::npos);
  CHECK(page.find("round-1.rig") != std::string::npos);
  CHECK(page.find("round-2.rig") == std::string::npos);
  CHECK(page.find("It measured nothing: There was no clock.") != std::string::npos);
  state.ending->end = End::undecidable;
  CHECK(claim().find("The sessions do not determine whether physics is missing") == 0);
  CHECK(page.find("The stage has play.") != std::string::npos);
  CHECK(page.find("The prediction was confirmed.") != std::string::npos);
}

}  // namespace investigate_test
