// SPDX-License-Identifier: MIT
// What goes wrong at a bench, as the operator of `rig run` meets it: each names the fault and its remedy, and
// ends with its own exit status.
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <catch2/catch.hpp>
#include <cstdlib>
#include <fstream>
#include <map>

#include "rig/session/session_store.hpp"
#include "tests/support/programs.hpp"
#include "tests/support/results.hpp"
#include "tests/support/run_bench.hpp"

namespace run_failures_test {

using Catch::Matchers::Contains;
using nlohmann::json;
using run_bench::Bench;
using run_bench::measured;
using run_bench::procedures;
using run_bench::small_bench;

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
  const auto waiting = message_with(rig, "waiting for the lidar");
  REQUIRE(waiting);
  CHECK_THAT(*waiting,
             Contains("nothing listens at 127.0.0.3:1 (") && Contains("Check") && Contains("Ctrl-C"));
  rig.signal(SIGINT);
  CHECK(rig.exit_status(std::chrono::seconds(10)) == 1);
  CHECK_THAT(rig.errors(), Contains("Stopped by the operator") && Contains("Nothing was captured yet") &&
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

TEST_CASE("a run replaces a session in which nothing was ever done, and no other") {
  Bench bench;
  const std::string out = bench.folder / "out.rig";
  { const rig::SessionStore killed_at_once(out, rig::SessionStore::Mode::create); }
  CHECK(bench.run("  - home\n  - capture: {samples: 5}\n") == 0);
  CHECK(measured(out).size() == 1);
  CHECK(bench.run("  - home\n  - capture: {samples: 5}\n") == 2);
  CHECK_THAT(bench.said, Contains("exists already"));
  CHECK(measured(out).size() == 1);
}

TEST_CASE("what is no procedure or no session is said to be that, with what to do") {
  const Bench bench;
  const std::string out = bench.folder / "out.rig";
  { const rig::SessionStore session(out, rig::SessionStore::Mode::create); }
  const auto said = [&](std::vector<std::string> words) {
    words.insert(words.begin(), RIG_BIN_DIR "/rig");
    Program rig(words, bench.folder);
    CHECK(rig.exit_status() == 2);
    return rig.errors();
  };
  CHECK_THAT(said({"run", out, "--bench", "bench.json"}),
             Contains("is a session, not a procedure") && Contains("rig resume"));
  CHECK_THAT(said({"resume", "/dev/zero"}), Contains("not a regular file"));
  CHECK_THAT(said({"fit", "noise", "none.rig"}), Contains("none.rig: no such session file"));
  bench.write("latin.yaml",
              "procedure: test\n# Pr\xFC"
              "fung\nsteps:\n  - home\n");
  CHECK_THAT(said({"run", "latin.yaml", "--bench", "bench.json"}),
             Contains("latin.yaml:2:5") && Contains("iconv"));
  bench.write("p.yaml", "procedure: test\nvariables: {who: x}\nsteps:\n  - home\n");
  CHECK_THAT(said({"run", "p.yaml", "--bench", "bench.json", "--set", "who=M\xFCller"}), Contains("UTF-8"));
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

TEST_CASE("the demo ends where the background board does not stand as it asks for") {
  std::string truth = small_bench;
  for (const std::string end : {"[2200, -900]", "[2200, 900]"}) truth.replace(truth.find(end) + 1, 4, "3000");
  const Bench bench({}, truth);
  Program rig(bench.command(procedures + "demo.yaml"), bench.folder);
  CHECK(rig.exit_status() == 1);
  CHECK_THAT(rig.errors(), Contains("'Background board at 2.2 m' is not as requested"));
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
  CHECK_THAT(alone.errors(), Contains("Nobody can answer") && Contains("--yes") && Contains("rig resume"));

  // Before the first step: no session is left, and none is to be resumed.
  std::filesystem::remove(bench.folder / "out.rig");
  std::string implausible = small_bench;
  implausible.replace(implausible.find("0.85"), 4, "85");
  bench.write("bench.json", implausible);
  Program unbegun(command, bench.folder);
  unbegun.end_input();
  CHECK(unbegun.exit_status() == 2);
  CHECK_THAT(unbegun.errors(), Contains("Nobody can answer") && !Contains("rig resume"));
  CHECK_FALSE(std::filesystem::exists(bench.folder / "out.rig"));
}

TEST_CASE("a limit that is not met is exit status 1 with the limit in the summary") {
  Bench bench;
  bench.write("p.yaml",
              "procedure: test\nsteps:\n  - home\n  - capture: {samples: 50}\n  - fit: {kind: noise}\n"
              "limits:\n  - {name: Noise, of: noise.noise_median_mm, max: 1}\n");
  Program rig(bench.command(bench.folder / "p.yaml"), bench.folder);
  CHECK(rig.exit_status() == 1);
  CHECK_THAT(rig.errors(), Contains("fail") && Contains("Noise") && Contains("not every limit is met"));
  Program resumed({RIG_BIN_DIR "/rig", "resume", bench.folder / "out.rig"}, bench.folder);
  CHECK(resumed.exit_status() == 1);
  CHECK_THAT(resumed.errors(), Contains("nothing is left to resume") && Contains("not every limit is met"));
}

TEST_CASE("a validation without a correction is said before anything moves") {
  const Bench bench;
  const auto said = [&](std::vector<std::string> more) {
    more.emplace_back("--dry-run");
    Program rig(bench.command(procedures + "range-validation.yaml", std::move(more)), bench.folder);
    std::string output;
    while (const auto line = rig.line()) output += *line + "\n";
    CHECK(rig.exit_status() == 0);
    return output;
  };
  CHECK_THAT(said({}), Contains("range-validation.yaml:22:") && Contains("no correction is given"));
  const std::string good = RIG_SOURCE_DIR "/tests/fuzz/corpus/correction/line.json";
  CHECK_THAT(said({"--set", "correction=" + good}), !Contains("no correction is given"));
}

TEST_CASE("a correction or a centre that is not there is refused with its place before anything is opened") {
  const Bench bench;
  const std::string good = RIG_SOURCE_DIR "/tests/fuzz/corpus/correction/line.json";
  for (const std::string wrong : {"correction=typo.rig", "correction=typo.json", "centre=typo.rig"}) {
    std::vector<std::string> set = {"--set", wrong};
    if (wrong.starts_with("centre")) set.insert(set.end(), {"--set", "correction=" + good});
    Program rig(bench.command(procedures + "range-validation.yaml", set), bench.folder);
    CHECK(rig.exit_status() == 2);
    CHECK_THAT(rig.errors(), Contains("range-validation.yaml:22:") && Contains("typo."));
    CHECK_FALSE(std::filesystem::exists(bench.folder / "out.rig"));
  }
}

TEST_CASE("a limit that no result of the run can have is refused with its place before anything moves") {
  Bench bench;
  const auto refused = [&](const std::string& of) {
    bench.write("p.yaml",
                "procedure: test\nsteps:\n  - home\n  - capture: {samples: 50}\n  - fit: {kind: noise}\n"
                "limits:\n  - {name: Noise, of: " +
                    of + ", max: 1}\n");
    Program rig(bench.command(bench.folder / "p.yaml", {"--dry-run"}), bench.folder);
    CHECK(rig.exit_status() == 2);
    CHECK_THAT(rig.errors(), Contains("p.yaml:7:23: "));
    return rig.errors();
  };
  CHECK_THAT(refused("noise.nosuch"), Contains("gives no value 'nosuch'") && Contains("noise_median_mm"));
  CHECK_THAT(refused("noize.noise_median_mm"), Contains("did you mean 'noise'?"));
  CHECK_THAT(refused("centre.centre_x_mm"),
             Contains("no step of the procedure computes") && Contains("fit: {kind: centre}"));
}

TEST_CASE("a second simulator does not take the first one's link, and takes that of one that was killed") {
  const TestFolder folder;
  std::ofstream(folder / "bench.json") << R"({"schema": "bench/1"})";
  const std::vector<std::string> command = {RIG_BIN_DIR "/rig-sim", "--bench", folder / "bench.json",
                                            "--lidar-port",         "0",       "--stage-link",
                                            folder / "stage"};
  Program first(command, folder);
  REQUIRE(first.line(std::chrono::seconds(30)));
  const auto stage = std::filesystem::read_symlink(folder / "stage");
  Program second(command, folder);
  CHECK(second.exit_status() != 0);
  CHECK_THAT(second.errors(), Contains("another simulator"));
  CHECK(std::filesystem::read_symlink(folder / "stage") == stage);
  first.signal(SIGKILL);
  static_cast<void>(first.exit_status());
  // Another one gets the number of the pseudo-terminal that is free now: the link that was left leads there.
  std::vector<std::string> elsewhere = command;
  elsewhere.back() = folder / "other stage";
  Program other(elsewhere, folder);
  REQUIRE(other.line(std::chrono::seconds(30)));
  Program third(command, folder);
  CHECK(third.line(std::chrono::seconds(30)));
  CHECK(std::filesystem::read_symlink(folder / "stage") !=
        std::filesystem::read_symlink(folder / "other stage"));
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
  const std::string errors = bad.errors();
  INFO(errors);
  const auto seen = errors.find("it is seen ");
  REQUIRE(seen != errors.npos);
  CHECK(std::atof(errors.c_str() + seen + 11) ==
        Approx(200).margin(10));  // the mean of 40 scans of 5 mm noise
  CHECK_THAT(errors, Contains("mm nearer than asked"));

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

TEST_CASE("a check that Ctrl-C ends says so when the stage could not be stopped, in its document too") {
  Bench bench({"--speed", "real"});
  Program check({RIG_BIN_DIR "/rig", "check", "--bench", bench.folder / "bench.json", "--lidar",
                 bench.sim->lidar(), "--stage", bench.sim->stage(), "--json", bench.folder / "check.json"},
                bench.folder);
  while (check.errors().find("units/deg") == std::string::npos)
    REQUIRE_FALSE(check.ends_within(std::chrono::milliseconds(20)));
  (void)bench.sim->ask({{"fault", "stage dead s=60"}});
  check.signal(SIGINT);
  CHECK(check.exit_status() == 1);
  CHECK_THAT(check.errors(), Contains("Stopped by the operator. The stage could not be stopped: "));
  const json document = json::parse(file_text(bench.folder / "check.json"));
  CHECK_FALSE(document.at("lines").empty());
  CHECK_THAT(document.at("error").get<std::string>(),
             Contains("Stopped by the operator. The stage could not be stopped: "));
}

TEST_CASE("an operator's port at which nothing listens is reported at once, as that") {
  Bench bench;
  boost::asio::io_context io;
  boost::asio::ip::tcp::acceptor closed(io, {boost::asio::ip::make_address("127.0.0.1"), 0});
  const std::string port = std::to_string(closed.local_endpoint().port());
  closed.close();
  bench.write("p.yaml", "procedure: test\nsteps:\n  - prompt: {title: x, place: {target: board}}\n");
  Program rig({RIG_BIN_DIR "/rig", "run", bench.folder / "p.yaml", "--lidar", bench.sim->lidar(), "--stage",
               bench.sim->stage(), "--bench", bench.folder / "bench.json", "--operator",
               "tcp://127.0.0.1:" + port, "--out", bench.folder / "out.rig"},
              bench.folder);
  CHECK(rig.exit_status() == 3);
  CHECK_THAT(rig.errors(), Contains("cannot be used (Connection refused)") && Contains("Nothing was placed"));
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

}  // namespace run_failures_test
