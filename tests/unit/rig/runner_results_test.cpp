// SPDX-License-Identifier: MIT
#include <future>

#include "rig/live/session_state.hpp"
#include "rig/runner/run_view.hpp"
#include "rig/session/standing.hpp"
#include "tests/support/runner_rig.hpp"

namespace runner_results_test {

using Catch::Matchers::Contains;
using nlohmann::json;
using namespace runner_rig;
namespace asio = boost::asio;

TEST_CASE("a limit that is not met is the run's result, not an error") {
  Rig rig("  - home\n  - capture: {samples: 5}\n  - fit: {kind: noise}\n",
          "limits:\n  - {name: noise, of: noise.sigma, max: 5}\n");
  rig.fitted = {{"schema", "result/1"},
                {"kind", "noise"},
                {"values", {{{"name", "sigma"}, {"value", 9.0}, {"u", 0.1}, {"unit", "mm"}}}}};
  CHECK_FALSE(rig.run());
  rig.fitted["values"][0]["value"] = 3.0;
  Rig good("  - home\n  - capture: {samples: 5}\n  - fit: {kind: noise}\n",
           "limits:\n  - {name: noise, of: noise.sigma, max: 5}\n");
  good.fitted = rig.fitted;
  CHECK(good.run());
}

TEST_CASE("while a fit computes, whatever else is ready is served") {
  Rig rig("  - home\n  - capture: {samples: 5}\n  - fit: {kind: noise}\n");
  std::size_t captures_seen = 0;
  bool served_meanwhile = false;
  rig.fit = [&](const std::string&, const rig::SessionStore& session, const json&) {
    const auto served = std::make_shared<std::promise<void>>();
    const auto waiting = served->get_future();
    asio::post(rig.io, [served] { served->set_value(); });
    served_meanwhile = waiting.wait_for(std::chrono::seconds(60)) == std::future_status::ready;
    captures_seen = session.recording()->captures().size();
    return rig.fitted;
  };
  CHECK(rig.run());
  CHECK(served_meanwhile);
  CHECK(captures_seen == 1);
}

TEST_CASE("an abort while a fit computes is answered at once, and what the fit gives is thrown away") {
  Rig rig("  - home\n  - capture: {samples: 5}\n  - fit: {kind: noise}\n");
  rig::Runner* running = nullptr;
  rig.prepare = [&](rig::Runner& runner) { running = &runner; };
  std::promise<void> ended;
  const auto end = ended.get_future().share();
  bool ended_before_the_fit = false;
  rig.fit = [&](const std::string&, const rig::SessionStore&, const json&) {
    asio::post(rig.io, [&] { running->abort(); });
    ended_before_the_fit = end.wait_for(std::chrono::seconds(60)) == std::future_status::ready;
    return rig.fitted;
  };
  rig.when_ended = [&] { ended.set_value(); };
  CHECK_THROWS_AS(rig.run(), rig::RunStopped);
  CHECK(ended_before_the_fit);
  CHECK(rig.stage.stops >= 1);
  CHECK_FALSE(rig::SessionStore(rig.file, rig::SessionStore::Mode::read).latest_result("noise"));
  CHECK_FALSE(std::filesystem::exists(rig.file.string() + "-wal"));  // One plain file, as after every run.
  rig.fit = [&](const std::string&, const rig::SessionStore&, const json&) { return rig.fitted; };
  rig.when_ended = [] {};
  CHECK(rig.run());
  CHECK(rig.captures().size() == 1);
}

TEST_CASE("what a fit says against the data ends the run in its own words, and the devices are safe") {
  Rig rig("  - home\n  - capture: {samples: 5}\n  - fit: {kind: noise}\n");
  rig.fit = [](const std::string&, const rig::SessionStore&, const json&) -> json {
    throw rig::MeasurementError("too few captures.");
  };
  CHECK_THROWS_AS(rig.run(), rig::MeasurementError);
  CHECK_THROWS_WITH(rig.run(), Contains("too few captures."));
  CHECK(rig.stage.stops >= 2);
}

TEST_CASE(
    "a limit tells what was measured, what is allowed, and by how much and on which side it is missed") {
  struct Row {
    std::optional<double> min, max, max_expanded, u;
    bool guarded;
    std::string verdict, text;
  };
  const std::vector<Row> rows = {
      {{},
       5,
       {},
       0.1,
       false,
       "fail",
       "9.00 ± 0.20 mm; allowed: at most 5 mm; 4.00 mm above the largest value allowed"},
      {10,
       {},
       {},
       0.1,
       false,
       "fail",
       "9.00 ± 0.20 mm; allowed: at least 10 mm; 1.00 mm below the smallest value allowed"},
      {8, 10, {}, 0.1, true, "pass", "9.00 ± 0.20 mm; allowed: 8 to 10 mm"},
      {9.1,
       12,
       {},
       0.1,
       true,
       "inconclusive",
       "9.00 ± 0.20 mm; allowed: 9.1 to 12 mm; 0.10 mm below the smallest value allowed, within the guard "
       "band "
       "of 0.20 mm"},
      {1,
       9.1,
       {},
       0.1,
       true,
       "inconclusive",
       "9.00 ± 0.20 mm; allowed: 1 to 9.1 mm; 0.10 mm below the largest value allowed, within the guard band "
       "of 0.20 mm"},
      {{},
       10,
       0.1,
       0.1,
       false,
       "fail",
       "9.00 ± 0.20 mm; allowed: at most 10 mm, U at most 0.1 mm; its uncertainty is larger than the 0.1 mm "
       "allowed"},
      {{},
       {},
       0.1,
       {},
       false,
       "fail",
       "9 mm; allowed: U at most 0.1 mm; its uncertainty is not known, and at most 0.1 mm is allowed"},
      {{},
       10,
       {},
       {},
       true,
       "inconclusive",
       "9 mm; allowed: at most 10 mm; its uncertainty is not known, and so its guard band is not"}};
  for (const Row& row : rows) {
    const Rig rig("  - home\n");
    rig::SessionStore session(rig.file, rig::SessionStore::Mode::create);
    json value = {{"name", "sigma"}, {"value", 9.0}, {"unit", "mm"}};
    if (row.u) value["u"] = *row.u;
    session.add_result("noise", json{{"values", {value}}}.dump());
    rig::Limit limit;
    limit.name = "noise", limit.kind = "noise", limit.value = "sigma";
    limit.min = row.min, limit.max = row.max, limit.max_expanded = row.max_expanded;
    limit.guarded = row.guarded;
    const json check = rig::check_limits({limit}, session)["checks"][0];
    CHECK(check["verdict"] == row.verdict);
    CHECK(check["text"] == row.text);
  }
}

TEST_CASE("a limit is not met by a result that contradicts itself or the bench file") {
  const Rig rig("  - home\n");
  rig::SessionStore session(rig.file, rig::SessionStore::Mode::create);
  rig::Limit limit;
  limit.name = "width", limit.kind = "sensitivity", limit.value = "window_deg", limit.max = 0.1;
  const auto verdict_with = [&](const char* more) {
    session.add_result(
        "sensitivity",
        std::string(R"({"values":[{"name":"window_deg","value":0.009,"u":0.01,"unit":"deg"}])") + more + "}");
    const json check = rig::check_limits({limit}, session)["checks"][0];
    return check["verdict"].get<std::string>() + ": " + check["reason"].get<std::string>();
  };
  CHECK(verdict_with("") == "pass: ");
  CHECK(verdict_with(R"(,"comparisons":[{"far_apart":true,"says":"Width: 0.05 and 0.009"}])") ==
        "inconclusive: the result is in doubt: Two methods do not agree. Width: 0.05 and 0.009.");
  CHECK(verdict_with(R"(,"contradictions":["The edge is elsewhere."])") ==
        "inconclusive: the result is in doubt: The edge is elsewhere.");
}

TEST_CASE("a run says that a result is in doubt, when it comes and at the end") {
  Rig rig("  - home\n  - fit: {kind: noise}\n");
  rig.fitted = {{"values", nlohmann::json::array()}, {"contradictions", {"The board is elsewhere."}}};
  std::string summary;
  rig.prepare = [&](rig::Runner& runner) {
    rig.when_ended = [&] {
      const rig::SessionStore session(rig.file, rig::SessionStore::Mode::read);
      summary = rig::summary_text(runner.state(), session, 1);
    };
  };
  CHECK(rig.run());
  CHECK(rig.reported("DOUBTFUL: noise: The board is elsewhere."));
  CHECK_THAT(summary, Contains("DOUBTFUL: noise: The board is elsewhere."));
}

TEST_CASE("who watches a session sees the procedure's steps, and limits with figures and verdict") {
  Rig rig("  - home\n  - capture: {samples: 5}\n  - fit: {kind: noise}\n  - wait: {seconds: 1}\n",
          "limits:\n  - {name: noise, of: noise.sigma, max: 5}\n");
  rig.fitted = {{"schema", "result/1"},
                {"kind", "noise"},
                {"values", {{{"name", "sigma"}, {"value", 9.0}, {"u", 0.1}, {"unit", "mm"}}}}};
  json live;
  rig.prepare = [&](rig::Runner& runner) {
    runner.observe([&](const rig::RunState& state) { live = rig::to_json(state, small_bench()); });
  };
  CHECK_FALSE(rig.run());
  const std::string figures =
      "9.00 ± 0.20 mm; allowed: at most 5 mm; 4.00 mm above the largest value allowed";
  const json row = {{"name", "noise"}, {"text", figures}, {"verdict", "fail"}};
  CHECK(live["results"] == json::array({row}));  // In braces compilers disagree on what it is.
  const json watched = rig::state_of(rig::SessionStore(rig.file, rig::SessionStore::Mode::read));
  CHECK(watched["results"] == json{{{"name", "sigma"}, {"text", "9.00 ± 0.20 mm"}}, row});
  CHECK(watched["step"]["n"] == 4);
  CHECK(watched["step"]["of"] == 4);
  REQUIRE(watched["steps"].size() == 4);
  CHECK(watched["steps"][1] == json{{"number", "2"}, {"text", "capture 5 scans"}, {"state", "recorded"}});
}

TEST_CASE("a session that is removed after the last capture is saved before the run ends") {
  const std::string last = GENERATE("", "  - fit: {kind: noise}\n", "  - report: {file: test.html}\n");
  Rig rig("  - home\n  - capture: {samples: 5}\n  - move: {to_deg: 5}\n" + last);
  rig.prepare = [&rig](rig::Runner& runner) {
    runner.observe([&rig](const rig::RunState& state) {
      if (state.stage_deg > 4) std::filesystem::remove(rig.file);
    });
  };
  CHECK_THROWS_WITH(rig.run(), Contains("was removed") && Contains(".rescued"));
  rig.prepare = [](rig::Runner&) {};
  std::filesystem::rename(rig.file.string() + ".rescued", rig.file);
  CHECK(rig.run());
  CHECK(rig.captures().size() == 1);
}

TEST_CASE("a report made while anything else is left to do is one of an unfinished procedure") {
  Rig rig(
      "  - home\n  - report: {file: a.html}\n  - capture: {samples: 5}\n"
      "  - report: {file: b.html}\n  - report: {file: c.html}\n");
  std::vector<std::string> said;
  rig.report = [&](const std::string& file, const std::string&) {
    said.push_back(rig::unfinished(rig::SessionStore(file, rig::SessionStore::Mode::read)));
    return rig::RunnerParts::Written{};
  };
  CHECK(rig.run());
  CHECK(said == std::vector<std::string>{"it was killed, or still runs; 1 of 5 steps are done", "", ""});
  CHECK(rig::SessionStore(rig.file, rig::SessionStore::Mode::read).get("ended") == "done");
}

TEST_CASE("a report cannot leave the session's folder, and is refused before anything moves") {
  for (const char* file :
       {"/tmp/report.html", "../report.html", "a/../../report.html", "report.exe", "bench.json/.."}) {
    INFO(file);
    Rig rig("  - home\n  - report: {file: '" + std::string(file) + "'}\n");
    CHECK_THROWS_WITH(rig.run(), Contains("test.yaml:4:"));
    CHECK(rig.stage.homings == 0);
  }
}

TEST_CASE("a report does not follow a link out of the session's folder") {
  const std::string name = "runner-test-link-" + std::to_string(getpid());
  const auto link = std::filesystem::temp_directory_path() / name;
  for (const char* there : {"/usr", "/tmp/.."}) {
    std::filesystem::create_directory_symlink(there, link);
    Rig rig("  - home\n  - report: {file: '" + name + "/report.html'}\n");
    CHECK_THROWS_WITH(rig.run(), Contains("outside the session's folder"));
    std::filesystem::remove(link);
  }
  const auto report = link.string() + ".html";
  std::filesystem::create_symlink("/nowhere/report.html", report);
  Rig rig("  - home\n  - report: {file: '" + name + ".html'}\n");
  CHECK_THROWS_WITH(rig.run(), Contains("outside the session's folder"));
  std::filesystem::remove(report);
}

}  // namespace runner_results_test
