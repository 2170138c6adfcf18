// SPDX-License-Identifier: MIT
// `rig run` as its operator meets it: two programs, real sockets, a real pseudo-terminal.
#include <catch2/catch.hpp>
#include <cstdlib>
#include <random>

#include "rig/session/session_store.hpp"
#include "tests/support/programs.hpp"
#include "tests/support/results.hpp"
#include "tests/support/run_bench.hpp"

namespace run_test {

using Catch::Matchers::Contains;
using nlohmann::json;
using run_bench::Bench;
using run_bench::measured;
using run_bench::procedures;
using run_bench::small_bench;

TEST_CASE("the demo calibrates the simulated bench within its stated uncertainty") {
  TestFolder folder;
  SimProgram sim(folder, procedures + "demo.truth.bench.json");
  Program rig({RIG_BIN_DIR "/rig", "run", procedures + "demo.yaml", "--bench", procedures + "demo.bench.json",
               "--lidar", sim.lidar(), "--stage", sim.stage(), "--operator", sim.person(), "--out",
               folder / "demo.rig", "--set", "samples=1000", "--set", "edge_samples=200"},
              folder);
  const int status = rig.exit_status(std::chrono::seconds(120));
  INFO(rig.errors());
  REQUIRE(status == 0);
  const json centre = latest_result(folder / "demo.rig", "centre");
  const fit::Estimate x = value_of(centre, "centre_x_mm"), y = value_of(centre, "centre_y_mm");
  const fit::Estimate window = value_of(latest_result(folder / "demo.rig", "sensitivity"), "window_deg");
  // Three expanded uncertainties: the coverage itself is tested over many seeds elsewhere.
  CHECK(x.value == Approx(-1.63).margin(3 * x.u));
  CHECK(y.value == Approx(-12.65).margin(3 * y.u));
  CHECK(window.value == Approx(0.05).margin(0.01));
  CHECK_THAT(file_text(folder / "demo.html"), Contains("</html>"));
  CHECK_THAT(rig.errors(), Contains("Limits:") && Contains("pass"));
}

TEST_CASE("a word that is no subcommand is named, with the one that was meant") {
  TestFolder folder;
  Program rig({RIG_BIN_DIR "/rig", "exprot", "a.rig"}, folder);
  CHECK(rig.exit_status() == 2);
  CHECK_THAT(rig.errors(), Contains("no subcommand 'exprot'; did you mean 'export'?"));
}

TEST_CASE("a mistyped option, a forgotten value and an argument too many are named") {
  TestFolder folder;
  const std::vector<std::pair<std::vector<std::string>, std::string>> wrong = {
      {{"--versio"}, "rig has no option '--versio' of its own; did you mean '--version'?"},
      {{"--bench=b.json", "run", "p.yaml"}, "those of a subcommand follow its name"},
      {{"run", "p.yaml", "--bnech", "b.json"}, "rig run has no option '--bnech'; did you mean '--bench'?"},
      {{"run", "p.yaml", "--banch=b.json"}, "rig run has no option '--banch'; did you mean '--bench'?"},
      {{"run", "p.yaml", "--bench", "--out", "a.rig"},
       "--bench: a value is missing: the option --out follows"},
      {{"explain", "--json", "--no-store", "a.rig"},
       "--json: a value is missing: the option --no-store follows"},
      {{"run", "p.yaml", "q.yaml"}, "'q.yaml' is one argument too many"},
      {{"run", "--hlep"}, "rig run has no option '--hlep'; did you mean '--help'?"},
      {{"fit"}, "rig: rig fit needs kind: Calibration to compute. `rig fit --help` says"},
      {{"check", "--lidar", "a", "--stage", "b"},
       "rig: rig check needs --bench: Bench file. `rig check --help` says"},
      {{"run", "p.yaml", "--live", "99999"}, "rig: rig run does not take '99999' for --live: "},
      {{"compare", "a.rig", "--with", "b.rig", "--names", "a"},
       "rig: rig compare takes 2 values for --names: "}};
  for (const auto& [words, message] : wrong) {
    std::vector<std::string> arguments = {RIG_BIN_DIR "/rig"};
    arguments.insert(arguments.end(), words.begin(), words.end());
    Program rig(arguments, folder);
    CHECK(rig.exit_status() == 2);
    CHECK_THAT(rig.errors(), Contains(message));
  }
}

TEST_CASE("a place that cannot hold a session is refused before anything moves, with what to do") {
  Bench bench;
  bench.write("p.yaml", "procedure: test\nsteps:\n  - home\n");
  bench.write("plain", "no folder");
  const std::vector<std::pair<std::string, std::string>> places = {
      {bench.folder / "", "it is a folder. Give the name of a file"},
      {"/dev/null", "Give the name of a file"},
      {bench.folder / "none/out.rig", "Make it first"},
      {bench.folder / "plain/out.rig", "is not a folder. Choose another place"}};
  for (const auto& [place, remedy] : places) {
    auto words = bench.command(bench.folder / "p.yaml");
    words.back() = place;
    Program rig(words, bench.folder);
    CHECK(rig.exit_status() == 2);
    CHECK_THAT(rig.errors(), Contains(remedy));
  }
}

TEST_CASE("a run that never met its lidar leaves no session in the way of the next attempt") {
  Bench bench;
  const std::string steps = "  - home\n  - capture: {samples: 20}\n";
  bench.lidar = "tcp://127.0.0.2:1";
  CHECK(bench.run(steps) == 3);
  CHECK_FALSE(std::filesystem::exists(bench.folder / "out.rig"));
  bench.lidar.clear();
  bench.write("bench.json", R"({"schema": "bench/1", "lidar": {"model": "UST-10LX", "front_step": 500}})");
  CHECK(bench.run(steps) == 2);
  CHECK_FALSE(std::filesystem::exists(bench.folder / "out.rig"));
  bench.write("bench.json", small_bench);
  CHECK(bench.run(steps) == 0);
}

TEST_CASE("a bench in metres is refused before anything moves") {
  Bench bench;
  bench.write("bench.json", R"({"schema": "bench/1", "lidar": {"model": "UST-10LX"},
    "targets": [{"name": "board", "from_mm": [1.4, -0.2], "to_mm": [1.4, 0.2]}]})");
  CHECK(bench.run("  - home\n") == 2);
  CHECK_THAT(bench.said,
             Contains("bench.json: all targets lie within 1.4 mm") && Contains("were metres meant?"));
}

TEST_CASE("a session in which nothing moved has no motion distortion, and deskew says so at once") {
  Bench bench;
  REQUIRE(bench.run(
              "  - home\n  - capture: {samples: 50}\n  - move: {to_deg: 10}\n  - capture: {samples: 50}\n") ==
          0);
  Program rig({RIG_BIN_DIR "/rig", "deskew", bench.folder / "out.rig", "-o", bench.folder / "straight.rig"},
              bench.folder);
  CHECK(rig.exit_status() == 1);
  CHECK_THAT(rig.errors(), Contains("stood still during every scan"));
  CHECK_FALSE(std::filesystem::exists(bench.folder / "straight.rig"));
}

TEST_CASE("homing leaves the stage at zero, wherever the last run left it") {
  Bench bench;
  REQUIRE(bench.run("  - home\n  - move: {to_deg: 60}\n") == 0);
  std::filesystem::remove(bench.folder / "out.rig");
  CHECK(bench.run("  - home\n  - capture: {samples: 20, beams_deg: [-3, 3]}\n") == 0);
  const rig::SessionStore session(bench.folder / "out.rig", rig::SessionStore::Mode::read);
  REQUIRE(session.recording()->captures().size() == 1);
  CHECK(session.recording()->captures()[0].stage_rad == Approx(0).margin(1e-4));
}

TEST_CASE("a session that is resumed brings its own bench, and one without says so") {
  Bench bench;
  const std::string steps = "  - home\n  - capture: {samples: 20}\n";
  CHECK(bench.run(steps) == 0);
  const auto resumed = [&](const std::string& out) {
    auto words = bench.command(bench.folder / "p.yaml", {"--resume"});
    const auto option = std::ranges::find(words, "--bench");
    words.erase(option, option + 2);
    words.end()[-2] = out;
    Program rig(words, bench.folder);
    const int status = rig.exit_status();
    bench.said = rig.errors();
    return status;
  };
  CHECK(resumed(bench.folder / "out.rig") == 0);
  CHECK(resumed(bench.folder / "none.rig") == 2);
  CHECK_THAT(bench.said, Contains("no session") && Contains("to resume") && Contains("--out"));
  { const rig::SessionStore empty(bench.folder / "empty.rig", rig::SessionStore::Mode::create); }
  CHECK(resumed(bench.folder / "empty.rig") == 2);
  CHECK_THAT(bench.said, Contains("holds no bench") && Contains("Give --bench FILE"));
}

TEST_CASE("rig resume needs nothing but the session, and asks for what is no longer there") {
  Bench bench;
  bench.write(
      "p.yaml",
      "procedure: test\nvariables: {samples: 20}\nsteps:\n  - home\n  - capture: {samples: '${samples}'}\n"
      "  - prompt: {title: 'Ready?'}\n  - capture: {samples: '${samples}'}\n");
  std::vector<std::string> command = {RIG_BIN_DIR "/rig",
                                      "run",
                                      bench.folder / "p.yaml",
                                      "--lidar",
                                      bench.sim->lidar(),
                                      "--stage",
                                      bench.sim->stage(),
                                      "--bench",
                                      bench.folder / "bench.json",
                                      "--out",
                                      bench.folder / "out.rig",
                                      "--set",
                                      "samples=7"};
  Program stopped(command, bench.folder);
  stopped.type("q\n");
  CHECK(stopped.exit_status() == 1);
  CHECK_THAT(stopped.errors(), Contains("Stopped by the operator") && Contains("rig resume"));
  std::filesystem::remove(bench.folder / "p.yaml");
  std::filesystem::remove(bench.folder / "bench.json");

  // The stage's port has another name now.
  const std::string port = bench.folder / "stage", real = std::filesystem::read_symlink(port);
  std::filesystem::remove(port);
  Program nobody({RIG_BIN_DIR "/rig", "resume", bench.folder / "out.rig"}, bench.folder);
  nobody.end_input();
  CHECK(nobody.exit_status() == 2);
  CHECK_THAT(nobody.errors(), Contains("which is no longer there") && Contains("give --stage"));
  Program resumed({RIG_BIN_DIR "/rig", "resume", bench.folder / "out.rig"}, bench.folder);
  resumed.type("serial:" + real + "?settle_s=0\n\n");
  CHECK(resumed.exit_status() == 0);
  INFO(resumed.errors());
  const rig::SessionStore session(bench.folder / "out.rig", rig::SessionStore::Mode::read);
  const auto recording = session.recording();
  REQUIRE(recording->captures().size() == 2);
  long scans = 0;
  recording->for_each_scan(1, [&](const fit::ScanView&) { ++scans; });
  CHECK(scans == 7);
  Program finished({RIG_BIN_DIR "/rig", "resume", bench.folder / "out.rig"}, bench.folder);
  CHECK(finished.exit_status() == 0);
  CHECK_THAT(finished.errors(), Contains("nothing is left to resume"));
}

TEST_CASE("a run that is killed at any moment and resumed ends as an undisturbed one") {
  const std::string steps =
      "  - home\n"
      "  - find-edge: {target: board, beam_deg: 0, samples: 40, search_deg: 2, spread: 1}\n"
      "  - move: {to_deg: '${edge_smooth_deg}'}\n"
      "  - capture: {samples: 2000, beams_deg: [-5, 5], target: board}\n"
      "  - sweep: {start_deg: -1, stop_deg: 1, step_deg: 0.5, samples: 100}\n"
      "  - fit: {kind: noise}\n";
  Bench bench({"--repeatable"});
  REQUIRE(bench.run(steps) == 0);
  const auto undisturbed = measured(bench.folder / "out.rig");
  const json values = latest_result(bench.folder / "out.rig", "noise").at("values");
  REQUIRE(undisturbed.size() > 10);
  std::filesystem::remove(bench.folder / "out.rig");

  std::mt19937 random(7);
  int kills = 0, status = -1;
  while (status != 0) {
    REQUIRE(kills < 100);
    Program rig(bench.command(bench.folder / "p.yaml", {"--resume"}), bench.folder);
    // Early runs are killed soon, so that every phase has its turn; later ones get on.
    const auto life = std::chrono::milliseconds(20 + random() % (200 + 60 * static_cast<unsigned>(kills)));
    if (kills < 12 && !rig.ends_within(life)) {
      rig.signal(SIGKILL);
      if (rig.exit_status() == -SIGKILL) {
        ++kills;
        continue;
      }
    }
    status = rig.exit_status();
    INFO(rig.errors());
    REQUIRE(status == 0);
  }
  CHECK(kills >= 5);
  CHECK(measured(bench.folder / "out.rig") == undisturbed);
  CHECK(latest_result(bench.folder / "out.rig", "noise").at("values") == values);
}

TEST_CASE("Ctrl-C stops the stage and keeps the data") {
  Bench bench({"--speed", "real"});
  bench.write("p.yaml", "procedure: test\nsteps:\n  - home\n  - capture: {samples: 4000}\n");
  Program rig(bench.command(bench.folder / "p.yaml", {"--json-log"}), bench.folder);
  for (int done = 0; done < 5;) {
    const auto line = rig.line();
    REQUIRE(line);
    const json what = json::parse(*line);
    if (what["type"] == "progress" && what["activity"] == "capturing") done = what["done"];
  }
  rig.signal(SIGINT);
  CHECK(rig.exit_status(std::chrono::seconds(15)) == 1);
  CHECK_THAT(rig.errors(), Contains("Stopped by the operator") && Contains("rig resume"));
  const rig::SessionStore session(bench.folder / "out.rig", rig::SessionStore::Mode::read);
  REQUIRE(session.recording()->captures().size() == 1);
  CHECK_THAT(session.recording()->captures()[0].step, Contains("(short)"));
}

TEST_CASE("a session is not written over and a finished one is not added to") {
  Bench bench;
  const std::string steps = "  - home\n  - capture: {samples: 5}\n";
  REQUIRE(bench.run(steps) == 0);
  const auto before = measured(bench.folder / "out.rig");
  CHECK(bench.run(steps) == 2);
  CHECK_THAT(bench.said, Contains("out.rig") && Contains("rig resume"));
  CHECK(bench.run(steps, {"--resume"}) == 0);
  CHECK(measured(bench.folder / "out.rig") == before);
}

TEST_CASE("a full disk ends the run with all that was captured and with room it goes on") {
  Bench bench({"--repeatable"});
  const std::string steps =
      "  - home\n  - sweep: {start_deg: -2, stop_deg: 2, step_deg: 0.5, samples: 120}\n";
  REQUIRE(bench.run(steps) == 0);
  const auto undisturbed = measured(bench.folder / "out.rig");
  std::filesystem::remove(bench.folder / "out.rig");
  bench.before = [] {
    const rlimit limit{4'000'000, RLIM_INFINITY};
    ::setrlimit(RLIMIT_FSIZE, &limit);
  };
  CHECK(bench.run(steps) == 1);
  INFO(bench.said);
  CHECK_THAT(bench.said, Contains("intact") && Contains("rig resume"));
  const auto kept = measured(bench.folder / "out.rig");
  CHECK(kept.size() >= 2);
  CHECK(kept.size() < undisturbed.size());
  bench.before = [] {};
  CHECK(bench.run(steps, {"--resume"}) == 0);
  CHECK(measured(bench.folder / "out.rig") == undisturbed);
}

TEST_CASE("a disk that is full before the first capture leaves no session in the way of the next attempt") {
  Bench bench;
  const std::string steps = "  - home\n  - capture: {samples: 5}\n";
  bench.before = [] {
    const rlimit limit{20'000, RLIM_INFINITY};
    ::setrlimit(RLIMIT_FSIZE, &limit);
  };
  CHECK(bench.run(steps) != 0);
  INFO(bench.said);
  CHECK_THAT(bench.said, Contains("disk"));
  CHECK_FALSE(std::filesystem::exists(bench.folder / "out.rig"));
  bench.before = [] {};
  CHECK(bench.run(steps) == 0);
}

TEST_CASE("a run that is killed while the stage turns leaves the stage standing") {
  Bench bench({"--speed", "real"});
  bench.write("p.yaml",
              "procedure: test\nsteps:\n  - home\n  - turn: {rate_deg_s: 2, from_deg: -20, samples: 600}\n");
  Program rig(bench.command(bench.folder / "p.yaml", {"--json-log"}), bench.folder);
  for (int done = 0; done < 5;) {
    const auto line = rig.line();
    REQUIRE(line);
    const json what = json::parse(*line);
    if (what["type"] == "progress" && what["step"] == 2) done = what["done"];
  }
  rig.signal(SIGKILL);
  CHECK(rig.exit_status() == -SIGKILL);
  // The next command on the same stage waits until its guard is through.
  Program check({RIG_BIN_DIR "/rig", "check", "--stay-still", "--lidar", bench.sim->lidar(), "--stage",
                 bench.sim->stage(), "--bench", bench.folder / "bench.json"},
                bench.folder);
  (void)check.exit_status();
  CHECK_THAT(check.errors(), Contains("homed") && Contains("yes"));
  const double first_deg = bench.sim->ask({{"get", "state"}})["stage_deg"];
  const double second_deg = bench.sim->ask({{"get", "state"}})["stage_deg"];
  CHECK(first_deg == second_deg);
  CHECK(first_deg > -20);
  CHECK(first_deg < 0);
}

TEST_CASE(
    "in the middle of a long move the stage is stopped by Ctrl-C, and when the run is killed or hangs") {
  const auto [signal, farthest_deg] = GENERATE(table<int, double>({
      {SIGKILL, 40},   // by its guard, at once: 20 deg/s
      {SIGINT, 40},    // by itself
      {SIGSTOP, 150},  // by its guard, which waits five seconds for a sign of life
  }));
  Bench bench({"--speed", "real"});
  bench.write("p.yaml", "procedure: test\nsteps:\n  - home\n  - move: {to_deg: 165}\n");
  Program rig(bench.command(bench.folder / "p.yaml", {"--json-log"}), bench.folder);
  const auto state = [&] { return bench.sim->ask({{"get", "state"}}); };
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(40);
  const auto in_time = [&] { return std::chrono::steady_clock::now() < until; };
  for (int step = 0; step < 2;) {
    const auto line = rig.line();
    REQUIRE(line);
    const json what = json::parse(*line);
    if (what["type"] == "progress") step = what["step"];
  }
  while (state()["stage_deg"].get<double>() < 5) REQUIRE(in_time());
  INFO("signal " << signal);
  const double struck_deg = state()["stage_deg"];
  rig.signal(signal);
  // Stands: the same true angle a third of a second later.
  json last = state(), now = last;
  while (now["stage_deg"] != last["stage_deg"] ||
         now["time_s"].get<double>() - last["time_s"].get<double>() < 0.3) {
    REQUIRE(in_time());
    if (now["stage_deg"] != last["stage_deg"]) last = now;
    now = state();
  }
  CHECK(now["stage_deg"].get<double>() - struck_deg >= 0);
  CHECK(now["stage_deg"].get<double>() < farthest_deg);
  if (signal == SIGINT) {
    CHECK(rig.exit_status() == 1);
    CHECK_THAT(rig.errors(), Contains("The stage has stopped"));
  }
}

}  // namespace run_test
