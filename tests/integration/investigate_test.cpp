// SPDX-License-Identifier: MIT
// `rig investigate` as users run it, on a simulated bench whose physics its bench file does not know.
#include <catch2/catch.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>

#include "rig/session/session_store.hpp"
#include "rig/session/sha256.hpp"
#include "tests/support/programs.hpp"

namespace investigate_test {
namespace {

using nlohmann::json;

/// A room seen by a coarse lidar, and a board in it; `known`: what the file knows of physics. Edges are
/// sharp: the simulator would mix them otherwise, which is physics that the file does not know.
std::string bench_text(const std::string& known) {
  return R"({"schema": "bench/1",
    "lidar": {"model": "UST-10LX", "steps": 271, "front_step": 135, "step_deg": 1, "scan_hz": 40,
              "mount": {"x_mm": {"value": 0, "u": 2}, "y_mm": {"value": 0, "u": 2}, "yaw_deg": {"value": 0, "u": 0.2}}},
    "stage": {"resolution_deg": 0.01, "speed_deg_s": 20},
    "sim": {"edge_window_deg": 0},
    "targets": [
      {"name": "east", "from_mm": [3100, -2200], "to_mm": [3100, 2000], "u_mm": 1, "u_deg": 0.05, "reflectance": 0.6},
      {"name": "north", "from_mm": [3100, 2000], "to_mm": [-2600, 2000], "u_mm": 1, "u_deg": 0.05, "reflectance": 0.5},
      {"name": "west", "from_mm": [-2600, 2000], "to_mm": [-2600, -2200], "u_mm": 1, "u_deg": 0.05, "reflectance": 0.5},
      {"name": "south", "from_mm": [-2600, -2200], "to_mm": [3100, -2200], "u_mm": 1, "u_deg": 0.05, "reflectance": 0.5},
      {"name": "board", "from_mm": [1000, -200], "to_mm": [1000, 200], "u_mm": 1, "u_deg": 0.1, "reflectance": 0.8}],
    "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": {"value": 4, "u": 1}}})" +
         known + "]}";
}

const std::string eccentric =
    R"(, {"mechanism": "encoder-eccentricity", "parameters": {"amplitude_deg": 0.25, "phase_deg": 40}})";

class InvestigatedBench {
 public:
  explicit InvestigatedBench(const std::string& hidden) {
    std::ofstream(folder_ / "bench.json") << bench_text("");
    std::ofstream(folder_ / "truth.json") << bench_text(hidden);
    sim_.emplace(folder_, folder_ / "bench.json",
                 std::vector<std::string>{"--truth", folder_ / "truth.json", "--seed", "5"});
  }
  [[nodiscard]] std::vector<std::string> command(std::vector<std::string> more) const {
    std::vector<std::string> words = {
        RIG_BIN_DIR "/rig", "investigate", "--bench", folder_ / "bench.json", "--lidar", sim_->lidar(),
        "--stage",          sim_->stage(), "--out",   folder_ / "out"};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  [[nodiscard]] const TestFolder& folder() const { return folder_; }
  [[nodiscard]] const SimProgram& sim() const { return *sim_; }
  [[nodiscard]] std::string out(const std::string& name) const { return folder_ / "out" + ("/" + name); }
  [[nodiscard]] json dossier() const { return json::parse(file_text(out("dossier.json"))); }

 private:
  TestFolder folder_;
  std::optional<SimProgram> sim_;
};

std::vector<std::string> named_in(const json& dossier) {
  std::vector<std::string> names;
  for (const json& found : dossier.at("found").at("mechanisms")) names.push_back(found.at("mechanism"));
  return names;
}

/// Captures of every session by their step, none twice.
void require_each_capture_once(const InvestigatedBench& bench) {
  for (const auto& file : std::filesystem::directory_iterator(bench.out(""))) {
    if (file.path().extension() != ".rig") continue;
    std::set<std::string> steps;
    const rig::SessionStore session(file.path(), rig::SessionStore::Mode::read);
    for (const fit::CaptureInfo& c : session.captures()) {
      INFO(file.path() << " " << c.step);
      CHECK(steps.insert(c.step).second);
      CHECK(c.step.find("(short)") == std::string::npos);
    }
  }
}

}  // namespace

TEST_CASE("hidden physics is named without an operator, and a recording that was predicted confirms it") {
  const InvestigatedBench bench(eccentric);
  Program rig(bench.command({"--unattended", "--budget-min", "10", "--json", "-"}), bench.folder());
  std::string printed;
  while (const auto line = rig.line(std::chrono::seconds(250))) printed += *line + "\n";
  const int status = rig.exit_status(std::chrono::seconds(250));
  INFO(rig.errors());
  REQUIRE(status == 0);
  const json dossier = bench.dossier();
  CHECK(json::parse(printed) == dossier);  // Nothing else is on standard output.
  CHECK(named_in(dossier) == std::vector<std::string>{"encoder-eccentricity"});
  CHECK(dossier.at("end").at("end") == "named");
  CHECK(dossier.at("hand_minutes") == 0);
  CHECK(dossier.at("confirmed") == true);
  rig::Sha256 hash;
  hash.feed(file_text(bench.out("prediction.json")));
  CHECK(dossier.at("last").at("sha256") == hash.hex());
  const double
      found = dossier.at("found").at("mechanisms").at(0).at("parameters").at("amplitude_deg").at("value"),
      u = dossier.at("found").at("mechanisms").at(0).at("parameters").at("amplitude_deg").at("u");
  CHECK(std::abs(found - 0.25) < 3 * u);
  // The campaign's table reads the dossier as it is written today.
  Program table({RIG_SOURCE_DIR "/scripts/challenge", "--dossier", bench.out("dossier.json"), "--hidden",
                 "encoder-eccentricity"},
                bench.folder());
  const auto line = table.line();
  INFO(table.errors());
  REQUIRE(line);
  CHECK(line->find("encoder-eccentricity: right (encoder-eccentricity (") != std::string::npos);
  CHECK(line->find("prediction confirmed") != std::string::npos);
  // The twin serves as it stands, and a second investigation in the folder is refused.
  CHECK_NOTHROW(fit::parse_bench(file_text(bench.out("twin.bench.json"))));
  Program again(bench.command({"--unattended"}), bench.folder());
  CHECK(again.exit_status() == 2);
  CHECK(again.errors().find("--resume") != std::string::npos);
}

TEST_CASE(
    "an investigation that Ctrl-C ends says how to continue it, not how to continue one session of it") {
  const InvestigatedBench bench("");
  Program rig(bench.command({"--unattended", "--json-log"}), bench.folder());
  bool measures = false;
  while (!measures) {
    const auto line = rig.line();
    REQUIRE(line);
    const json what = json::parse(*line);
    measures = what.at("type") == "progress" && what.at("step").get<int>() >= 3;
  }
  rig.signal(SIGINT);
  CHECK(rig.exit_status() == 1);
  CHECK_THAT(rig.errors(),
             Catch::Matchers::Contains("rig investigate --out " +
                                       bench.out("").substr(0, bench.out("").size() - 1) + " --resume") &&
                 !Catch::Matchers::Contains("rig resume"));
}

TEST_CASE(
    "Ctrl-C while an explanation is computed says how to continue, and that continues without --bench") {
  const InvestigatedBench bench("");
  std::vector<std::string> words = bench.command({"--unattended", "--budget-min", "10", "--json-log"});
  Program rig(words, bench.folder());
  // That a session is whole is written down before it is explained.
  const auto is_recorded = [&] {
    if (!std::filesystem::exists(bench.out("investigation.json"))) return false;
    return json::parse(file_text(bench.out("investigation.json")))
               .at("rounds")
               .at(0)
               .at("session")
               .at("recorded") == true;
  };
  for (int looks = 0; !is_recorded(); ++looks) {
    REQUIRE(looks < 6000);
    REQUIRE_FALSE(rig.ends_within(std::chrono::milliseconds(10)));
  }
  rig.signal(SIGINT);
  CHECK(rig.exit_status() == 1);
  CHECK_THAT(rig.errors(), Catch::Matchers::Contains("Stopped by the operator. What was recorded is kept; "
                                                     "continue with rig investigate --out"));
  std::erase(words, "--bench");
  std::erase(words, bench.folder() / "bench.json");
  words.emplace_back("--resume");
  Program again(words, bench.folder());
  const auto line = again.line(std::chrono::seconds(120));
  INFO(again.errors());
  REQUIRE(line);
  CHECK(json::parse(*line).at("type") == "investigation");
}

TEST_CASE("the dossier and the lines for programs do not share standard output") {
  const TestFolder folder;
  Program rig({RIG_BIN_DIR "/rig", "investigate", "--out", folder / "out", "--unattended", "--json", "-",
               "--json-log"},
              folder);
  CHECK(rig.exit_status() == 2);
  CHECK(rig.errors().find("--json-log would both write to standard output") != std::string::npos);
  CHECK_FALSE(std::filesystem::exists(folder / "out"));
}

TEST_CASE(
    "an investigation that does not exist is not continued, and a budget that the first session exceeds "
    "refused") {
  const InvestigatedBench bench(eccentric);
  Program missing(bench.command({"--unattended", "--resume"}), bench.folder());
  CHECK(missing.exit_status() == 2);
  CHECK(missing.errors().find("there is no investigation in") != std::string::npos);
  Program short_of_time(bench.command({"--unattended", "--budget-min", "0.05"}), bench.folder());
  CHECK(short_of_time.exit_status() == 2);
  CHECK(short_of_time.errors().find("more than the --budget-min of 0.05") != std::string::npos);
}

TEST_CASE(
    "an investigation that is killed between any two of its steps, and within a session, goes on where it "
    "was") {
  const InvestigatedBench bench(eccentric);
  // It dies at its first word, at its second, ...; every third time within the recording that follows.
  int killed = 0;
  for (int life = 1;; ++life) {
    REQUIRE(life < 40);
    std::vector<std::string> options{"--unattended", "--budget-min", "10", "--json-log"};
    if (life > 1) options.emplace_back("--resume");
    Program rig(bench.command(options), bench.folder());
    bool ended = true;
    int words = 0, progress = 0;
    while (const auto line = rig.line(std::chrono::seconds(120))) {
      const json said = json::parse(*line);
      words += said.at("type") == "investigation";
      progress += said.at("type") == "progress";
      const bool now = life % 3 == 0 ? progress > 5 : words > (life - 1) / 3 % 4;
      if (!now || killed >= 9) continue;
      rig.signal(SIGKILL);
      ++killed;
      ended = false;
      break;
    }
    const int status = rig.exit_status();
    INFO(rig.errors());
    if (!ended) continue;
    REQUIRE(status == 0);
    break;
  }
  CHECK(killed >= 5);  // As many as there are steps to be killed in; nine at most.
  CHECK(named_in(bench.dossier()) == std::vector<std::string>{"encoder-eccentricity"});
  CHECK(bench.dossier().at("confirmed") == true);
  require_each_capture_once(bench);
}

TEST_CASE("a program that reads only a prompt's place is operator enough") {
  const InvestigatedBench bench("");
  Program rig(bench.command({"--json-log", "--budget-min", "30"}), bench.folder());
  int placed = 0, answered = 0;
  while (const auto line = rig.line(std::chrono::seconds(120))) {
    const json said = json::parse(*line);
    if (said.at("type") == "investigation") answered = 0;  // Every session counts anew.
    if (said.at("type") != "progress" || !said.contains("prompt") ||
        said.at("prompt").at("number") == answered)
      continue;
    answered = said.at("prompt").at("number");
    const json answer = bench.sim().ask({{"place", said.at("prompt").at("place")}});
    REQUIRE(answer.at("ok") == true);
    rig.type("\n");
    ++placed;
  }
  const int status = rig.exit_status();
  INFO(rig.errors());
  REQUIRE(status == 0);
  CHECK(placed >= 7);  // of the first look, the last one put back
  CHECK(bench.dossier().at("end").at("end") == "nothing-missing");
  CHECK(bench.dossier().at("confirmed") == true);
}

}  // namespace investigate_test
