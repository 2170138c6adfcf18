// SPDX-License-Identifier: MIT
// `rig run` as its operator meets it: two programs, real sockets, a real pseudo-terminal.
#include <boost/asio/io_context.hpp>
#include <catch2/catch.hpp>
#include <cstdlib>
#include <random>

#include "rig/session/session_store.hpp"
#include "tests/support/programs.hpp"
#include "tests/support/results.hpp"

using Catch::Matchers::Contains;
using nlohmann::json;

namespace {

const std::string procedures = RIG_SOURCE_DIR "/procedures/";

/// A board that the rig sees at 1.4 m with a wall behind it; small enough for a run of a second.
constexpr const char* small_bench = R"({
  "schema": "bench/1",
  "lidar": {"model": "UST-10LX", "mount": {"x_mm": {"value": 0, "u": 15}, "y_mm": {"value": 0, "u": 15}}},
  "stage": {"language": "zaber", "model": "X-RSW60A", "limits_deg": [-170, 170], "speed_deg_s": 20},
  "targets": [
    {"name": "board", "from_mm": [1400, -200], "to_mm": [1400, 200], "reflectance": 0.85},
    {"name": "background", "from_mm": [2200, -900], "to_mm": [2200, 900], "reflectance": 0.6}],
  "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": 5}}]
})";

struct Bench {
  explicit Bench(std::vector<std::string> sim_options = {}, const std::string& truth = small_bench) {
    write("bench.json", small_bench);
    write("truth.json", truth);
    sim = std::make_unique<SimProgram>(folder, folder / "truth.json", std::move(sim_options));
  }

  void write(const std::string& name, const std::string& text) const { std::ofstream(folder / name) << text; }

  std::vector<std::string> command(const std::string& procedure, std::vector<std::string> more = {}) const {
    std::vector<std::string> words = {RIG_BIN_DIR "/rig",
                                      "run",
                                      procedure,
                                      "--lidar",
                                      lidar.empty() ? sim->lidar() : lidar,
                                      "--stage",
                                      sim->stage(),
                                      "--bench",
                                      folder / "bench.json",
                                      "--operator",
                                      sim->person(),
                                      "--out",
                                      folder / "out.rig"};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  /// Writes the steps as a procedure and runs it to its end.
  int run(const std::string& steps, std::vector<std::string> more = {}) {
    write("p.yaml", "procedure: test\nsteps:\n" + steps);
    Program rig(command(folder / "p.yaml", std::move(more)), folder, before);
    const int status = rig.exit_status();
    said = rig.errors();
    return status;
  }

  TestFolder folder;
  std::unique_ptr<SimProgram> sim;
  std::string lidar, said;
  std::function<void()> before = [] {};
};

/// Everything that a calibration depends on, capture by capture.
std::vector<std::string> measured(const std::string& file) {
  const rig::SessionStore session(file, rig::SessionStore::Mode::read);
  const auto recording = session.recording();
  std::vector<std::string> all;
  for (std::size_t i = 0; i < recording->captures().size(); ++i) {
    const auto& info = recording->captures()[i];
    std::string text = info.step + " " + std::to_string(info.stage_rad) + " " + std::to_string(info.approach);
    recording->for_each_scan(i, [&](const fit::ScanView& scan) {
      for (const auto range : scan.range_mm) text += " " + std::to_string(range);
      for (const auto level : scan.intensity) text += " " + std::to_string(level);
    });
    all.push_back(std::to_string(std::hash<std::string>{}(text)) + " " + text.substr(0, 60));
  }
  return all;
}

}  // namespace

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
      {{"run", "p.yaml", "--bnech", "b.json"}, "rig run has no option '--bnech'; did you mean '--bench'?"},
      {{"run", "p.yaml", "--banch=b.json"}, "rig run has no option '--banch'; did you mean '--bench'?"},
      {{"run", "p.yaml", "--bench", "--out", "a.rig"},
       "--bench: a value is missing: the option --out follows"},
      {{"explain", "--json", "--no-store", "a.rig"},
       "--json: a value is missing: the option --no-store follows"},
      {{"run", "p.yaml", "q.yaml"}, "'q.yaml' is one argument too many"}};
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

// What goes wrong at a bench: each names the fault and its remedy, and ends with its own exit status.

namespace {

/// The text of the first message of a run with --json-log that has these words; nothing when it ends before.
std::optional<std::string> message_with(Program& rig, const std::string& words) {
  while (const auto line = rig.line()) {
    const json what = json::parse(*line);
    if (what["type"] == "message" && what["text"].get<std::string>().find(words) != std::string::npos)
      return what["text"].get<std::string>();
  }
  return std::nullopt;
}

}  // namespace

TEST_CASE("while nothing listens at the lidar's address it is waited for, as is reported, until Ctrl-C") {
  Bench bench;
  bench.lidar = "tcp://127.0.0.3:1";
  bench.write("p.yaml", "procedure: test\nsteps:\n  - home\n");
  Program rig(bench.command(bench.folder / "p.yaml", {"--json-log"}), bench.folder);
  const auto told = message_with(rig, "waiting for the lidar");
  REQUIRE(told);
  CHECK_THAT(*told, Contains("nothing listens at 127.0.0.3:1 (") && Contains("Check") && Contains("Ctrl-C"));
  rig.signal(SIGINT);
  CHECK(rig.exit_status(std::chrono::seconds(10)) == 1);
  CHECK_THAT(rig.errors(), Contains("Stopped by the operator") && Contains("nothing was captured yet") &&
                               !Contains("rig resume") && !Contains("Session:"));
}

TEST_CASE("a lidar that is switched on after its run was started is waited for") {
  Bench bench;
  using boost::asio::ip::tcp;
  boost::asio::io_context io;
  tcp::socket port(io, tcp::v4());  // Keeps the number, and does not listen.
  port.set_option(boost::asio::socket_base::reuse_address(true));
  port.bind({boost::asio::ip::address_v4::loopback(), 0});
  const std::string number = std::to_string(port.local_endpoint().port());
  bench.lidar = "tcp://127.0.0.1:" + number;
  bench.write("p.yaml", "procedure: test\nsteps:\n  - home\n  - capture: {samples: 5}\n");
  Program rig(bench.command(bench.folder / "p.yaml", {"--json-log"}), bench.folder);
  REQUIRE(message_with(rig, "waiting for the lidar"));
  const TestFolder beside;
  Program late({RIG_BIN_DIR "/rig-sim", "--bench", bench.folder / "truth.json", "--lidar-port", number,
                "--stage-link", beside / "stage", "--speed", "max"},
               beside);
  CHECK(rig.exit_status() == 0);
  CHECK(measured(bench.folder / "out.rig").size() == 1);
}

TEST_CASE("a lidar's address whose name is not known ends the run at once") {
  Bench bench;
  bench.lidar = "tcp://no-such-host.invalid";
  CHECK(bench.run("  - home\n") == 3);
  CHECK_THAT(bench.said, Contains("no-such-host.invalid cannot be resolved") && !Contains("waiting"));
}

namespace {

/// Something that listens and answers whatever it hears with the same text.
class OtherService {
 public:
  OtherService(const TestFolder& folder, const std::string& says, int times = 1)
      : program_({"/usr/bin/python3", "-c",
                  "import socket,sys\n"
                  "s=socket.create_server(('127.0.0.1',0)); print(s.getsockname()[1],flush=True)\n"
                  "while True:\n"
                  "  c,_=s.accept()\n"
                  "  try:\n"
                  "    while c.recv(4096): c.sendall((sys.argv[1]*int(sys.argv[2])).encode('latin-1'))\n"
                  "  except OSError: pass\n",
                  says, std::to_string(times)},
                 folder) {
    port_ = program_.line().value_or("");
  }
  [[nodiscard]] std::string address() const { return "tcp://127.0.0.1:" + port_; }

 private:
  Program program_;
  std::string port_;
};

}  // namespace

TEST_CASE("another service at the lidar's port is told from a lidar") {
  Bench bench;
  const OtherService service(bench.folder, "HTTP/1.1 400 Bad Request\r\nConnection: keep-alive\r\n\r\n");
  bench.lidar = service.address();
  CHECK(bench.run("  - home\n  - capture: {samples: 5}\n") == 3);
  CHECK_THAT(bench.said, Contains("SCIP") && Contains(service.address().substr(6)));
}

TEST_CASE("a device that answers garbage ends the run, and endless garbage does not fill the memory") {
  Bench bench;
  const OtherService service(bench.folder, "garbage", 30'000);
  bench.lidar = service.address();
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // their shadow memory alone is larger
  bench.before = [] {
    const rlimit limit{600'000'000, RLIM_INFINITY};
    ::setrlimit(RLIMIT_DATA, &limit);
  };
#endif
  CHECK(bench.run("  - home\n  - capture: {samples: 5}\n") == 3);
  CHECK_THAT(bench.said, Contains("lidar") || Contains("SCIP"));
}

TEST_CASE("a serial port without permission is reported with its remedy") {
  Bench bench;
  if (::geteuid() == 0) {
    // Root may open everything, so the program runs as nobody, in a folder that nobody may write.
    std::filesystem::permissions(bench.folder.path(), std::filesystem::perms::all);
    bench.before = [] {
      if (::setgid(65534) != 0 || ::setuid(65534) != 0 || ::access(RIG_BIN_DIR "/rig", X_OK) != 0)
        ::_exit(77);
    };
  }
  std::filesystem::permissions(bench.folder / "stage", std::filesystem::perms::none);
  const int status = bench.run("  - home\n  - capture: {samples: 5}\n");
  if (status == 77) {
    WARN("skipped: the build folder is closed to other users");
    return;
  }
  CHECK(status == 3);
  CHECK_THAT(bench.said, Contains("stage") && Contains("dialout"));
}

TEST_CASE("a serial port that is not there is reported with its remedy") {
  Bench bench;
  Program rig(
      {RIG_BIN_DIR "/rig", "run", procedures + "demo.yaml", "--bench", bench.folder / "bench.json", "--lidar",
       bench.sim->lidar(), "--stage", "serial:/dev/ttyNOT0", "--out", bench.folder / "out.rig"},
      bench.folder);
  CHECK(rig.exit_status() == 3);
  CHECK_THAT(rig.errors(), Contains("/dev/ttyNOT0") && Contains("rig devices"));
}

TEST_CASE("rig devices shows what comes from a port that speaks no stage's language, and the likely remedy") {
  const TestFolder folder;
  Program port({"/usr/bin/python3", "-c",
                "import os,pty,tty\n"
                "ours,theirs=pty.openpty(); tty.setraw(theirs); print(os.ttyname(theirs),flush=True)\n"
                "while True:\n"
                "  os.read(ours,4096); os.write(ours,b'\\x81k\\xfe')\n"},
               folder);
  const std::string path = port.line().value_or("");
  Program devices({RIG_BIN_DIR "/rig", "devices", "--stage", "serial:" + path + "?baud=38400", "--lidar",
                   "tcp://127.0.0.4:1", "--json", "-"},
                  folder);
  std::string output;
  while (const auto line = devices.line()) output += *line + "\n";
  CHECK(devices.exit_status() == 3);
  CHECK_THAT(devices.errors(), Contains(R"("\x81k\xFE)") && Contains("at 38400 baud") &&
                                   Contains("another baud rate") && Contains("another device"));
  CHECK_THAT(json::parse(output)["ports"].back()["heard"]["bytes"].get<std::string>(),
             Contains(R"(\x81k\xFE)"));
}

TEST_CASE("a procedure that forgets homing is refused before anything moves") {
  Bench bench;
  CHECK(bench.run("  - move: {to_deg: 10}\n  - capture: {samples: 5}\n") == 2);
  CHECK_THAT(bench.said, Contains("p.yaml:3") && Contains("home"));
}

TEST_CASE("a stage that stalls again and again is stopped with a reason") {
  Bench bench({"--fault", "every=0.05s stage stall"});
  CHECK(bench.run("  - home\n  - move: {to_deg: 100}\n  - capture: {samples: 5}\n") == 3);
  CHECK_THAT(bench.said, Contains("stall"));
}

TEST_CASE("a misspelt key of a procedure is reported with its place and what was meant") {
  Bench bench;
  CHECK(bench.run("  - home\n  - capture: {sample: 5}\n") == 2);
  CHECK_THAT(bench.said, Contains("p.yaml:4:15") && Contains("samples"));
}

TEST_CASE("a procedure with a calibration that does not exist is refused before hours of captures") {
  Bench bench;
  CHECK(bench.run("  - home\n  - capture: {samples: 5}\n  - fit: {kind: center}\n") == 2);
  CHECK_THAT(bench.said, Contains("p.yaml:5") && Contains("centre"));
}

TEST_CASE("a bench that the captures contradict ends the run with what was seen and what was expected") {
  std::string elsewhere = small_bench;
  for (std::size_t at = 0; (at = elsewhere.find("[1400, ", at)) != std::string::npos; ++at)
    elsewhere.replace(at, 7, "[1900, ");
  Bench bench({}, elsewhere);
  CHECK(bench.run("  - home\n"
                  "  - prompt: {title: Put the board there, until: {beams_deg: [-2, 2], within_mm: [1380, "
                  "1420]}}\n") == 1);
  CHECK_THAT(bench.said, Contains("the rig sees 190") && Contains("1380 to 1420"));
  std::filesystem::remove(bench.folder / "out.rig");
  CHECK(bench.run(
            "  - home\n"
            "  - find-edge: {target: board, beam_deg: 0, near_deg: 60, search_deg: 2, samples: 20}\n") == 1);
  CHECK_THAT(bench.said, Contains("'board' is not in its place") && Contains("farther away"));
}

TEST_CASE("a person at the terminal is asked in plain words and answers by typing") {
  Bench bench;
  bench.write(
      "p.yaml",
      "procedure: test\nsteps:\n  - home\n"
      "  - prompt: {title: Measure the rail, text: With the tape., ask: {name: rail, unit: m, min: 1, max: "
      "2}}\n"
      "  - capture: {samples: 5}\n    name: 'at ${rail}'\n");
  std::vector<std::string> command = {
      RIG_BIN_DIR "/rig",          "run",     bench.folder / "p.yaml", "--lidar",
      bench.sim->lidar(),          "--stage", bench.sim->stage(),      "--bench",
      bench.folder / "bench.json", "--out",   bench.folder / "out.rig"};
  Program rig(command, bench.folder);
  rig.type("5\n1.25\n");
  CHECK(rig.exit_status() == 0);
  CHECK_THAT(rig.errors(), Contains("Measure the rail") && Contains("With the tape.") &&
                               Contains("in m, 1 to 2") && Contains("5 m is outside 1 to 2 m"));
  const rig::SessionStore session(bench.folder / "out.rig", rig::SessionStore::Mode::read);
  CHECK(session.recording()->captures().at(0).step == "at 1.25");

  std::filesystem::remove(bench.folder / "out.rig");
  Program alone(command, bench.folder);
  alone.end_input();
  CHECK(alone.exit_status() == 2);
  CHECK_THAT(alone.errors(), Contains("Nobody can answer") && Contains("--yes"));
}

TEST_CASE("a limit that is not met is exit status 1 with the limit in the summary") {
  Bench bench;
  bench.write("p.yaml",
              "procedure: test\nsteps:\n  - home\n  - capture: {samples: 50}\n  - fit: {kind: noise}\n"
              "limits:\n  - {name: Noise, of: noise.noise_median_mm, max: 1}\n");
  Program rig(bench.command(bench.folder / "p.yaml"), bench.folder);
  CHECK(rig.exit_status() == 1);
  CHECK_THAT(rig.errors(), Contains("fail") && Contains("Noise") && Contains("not every limit is met"));
}

TEST_CASE("a procedure can write a report nowhere but beside its session") {
  Bench bench;
  for (const char* place : {"../escaped.html", "/tmp/escaped.html", "a/../../escaped.html"}) {
    CHECK(bench.run("  - home\n  - report: {file: " + std::string(place) + "}\n") == 2);
    CHECK(!std::filesystem::exists("/tmp/escaped.html"));
    CHECK(!std::filesystem::exists(bench.folder / "../escaped.html"));
    std::filesystem::remove(bench.folder / "out.rig");
  }
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

TEST_CASE("two runs do not share a stage") {
  Bench bench({"--speed", "real"});
  bench.write("p.yaml", "procedure: test\nsteps:\n  - home\n  - capture: {samples: 4000}\n");
  Program first(bench.command(bench.folder / "p.yaml", {"--json-log"}), bench.folder);
  REQUIRE(first.line());
  auto command = bench.command(bench.folder / "p.yaml");
  command[command.size() - 1] = bench.folder / "other.rig";
  Program second(command, bench.folder);
  CHECK(second.exit_status() == 3);
  CHECK_THAT(second.errors(), Contains("in use by another program"));
}

TEST_CASE("the bench is walked through and what is wrong with it is reported") {
  Bench bench;
  const std::vector<std::string> devices = {"--lidar", bench.sim->lidar(), "--stage", bench.sim->stage()};
  std::vector<std::string> command = {RIG_BIN_DIR "/rig", "check", "--bench", bench.folder / "bench.json"};
  command.insert(command.end(), devices.begin(), devices.end());
  Program good(command, bench.folder);
  CHECK(good.exit_status() == 0);
  CHECK_THAT(good.errors(), Contains("full turn") && Contains("target board") && !Contains("BAD"));

  std::string wrong = small_bench;
  wrong.replace(wrong.find("[1400, -200]"), 12, "[1600, -200]");
  wrong.replace(wrong.find("[1400, 200]"), 11, "[1600, 200]");
  bench.write("wrong.json", wrong);
  command[3] = bench.folder / "wrong.json";
  Program bad(command, bench.folder);
  CHECK(bad.exit_status() == 1);
  CHECK_THAT(bad.errors(), Contains("BAD   target board") && Contains("Measure its place"));
  const std::string told = bad.errors();
  INFO(told);
  const auto seen = told.find("it is seen ");
  REQUIRE(seen != told.npos);
  CHECK(std::atof(told.c_str() + seen + 11) == Approx(200).margin(10));  // the mean of 40 scans of 5 mm noise
  CHECK_THAT(told, Contains("mm nearer than asked"));

  std::string other = small_bench;
  other.replace(other.find("\"UST-10LX\""), 10, "\"UTM-30LX\", \"front_step\": 500");
  bench.write("other.json", other);
  command[3] = bench.folder / "other.json";
  Program another(command, bench.folder);
  CHECK(another.exit_status() == 1);
  CHECK_THAT(another.errors(), Contains("BAD   model") && Contains("other.json:3:22") &&
                                   Contains("BAD   front step") && Contains("not checked"));

  (void)bench.sim->ask({{"fault", "lidar unwell"}});
  command[3] = bench.folder / "bench.json";
  Program ill(command, bench.folder);
  CHECK(ill.exit_status() == 1);
  CHECK_THAT(ill.errors(), Contains("BAD   lidar's state") && Contains("window is dirty"));
  (void)bench.sim->ask({{"fault", "lidar unwell on=0"}});

  Program found({RIG_BIN_DIR "/rig", "devices", "--lidar", bench.sim->lidar(), "--stage", bench.sim->stage(),
                 "--json", "-"},
                bench.folder);
  CHECK(found.exit_status() == 0);
  CHECK_THAT(found.errors(), Contains("UST-10LX") && Contains("zaber"));
}

TEST_CASE("what `rig new` writes runs as it stands") {
  Bench bench;
  for (const char* what : {"procedure", "bench"}) {
    Program make({RIG_BIN_DIR "/rig", "new", what}, bench.folder);
    CHECK(make.exit_status() == 0);
    Program again({RIG_BIN_DIR "/rig", "new", what}, bench.folder);
    CHECK(again.exit_status() == 2);
    CHECK_THAT(again.errors(), Contains("not overwritten"));
  }
  auto command = bench.command(bench.folder / "new.yaml");
  command[8] = bench.folder / "new.bench.json";
  Program rig(command, bench.folder);
  CHECK(rig.exit_status() == 0);
  INFO(rig.errors());
  CHECK(std::filesystem::exists(bench.folder / "starter.html"));
}

TEST_CASE("scans with wrong sums are never stored and those lost are reported") {
  Bench bench({"--fault", "every=0.3s lidar checksum", "--fault", "every=0.7s lidar flip"});
  REQUIRE(bench.run("  - home\n  - capture: {samples: 2000, beams_deg: [-3, 3], target: board}\n") == 0);
  CHECK_THAT(bench.said, Contains("lost") && Contains("discarded"));
  const rig::SessionStore session(bench.folder / "out.rig", rig::SessionStore::Mode::read);
  const auto recording = session.recording();
  REQUIRE(recording->captures().size() == 1);
  long scans = 0;
  std::int64_t before_ms = 0;
  bool right = true;
  recording->for_each_scan(0, [&](const fit::ScanView& scan) {
    ++scans;
    right = right && scan.device_ms > before_ms;
    before_ms = scan.device_ms;
    for (const auto range : scan.range_mm) right = right && range > 1350 && range < 1450;
  });
  CHECK(scans == 2000);
  CHECK(right);
}
