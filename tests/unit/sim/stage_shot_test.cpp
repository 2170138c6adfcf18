// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <string>

#include "sim/stage_device.hpp"

namespace stage_shot_test {
namespace {

struct Controller {
  explicit Controller(const std::string& language, int axes = 2) {
    options.language = language;
    options.physics = sim::usual_stage_physics(language);
    options.axes = axes;
    device = sim::make_stage_device(options);
  }
  std::string say(const std::string& text) { return device->receive(text + "\r\n", now_s); }
  /// Lets the motion under way end.
  void wait() {
    while (device->mechanics().moving(now_s)) now_s += 0.01;
    device->poll(now_s);
  }

  sim::StageDeviceOptions options;
  std::unique_ptr<sim::StageDevice> device;
  double now_s = 0;
};

}  // namespace

TEST_CASE("a SHOT's status has ten characters an axis and three letters, always as many") {
  Controller two("shot"), one("shot", 1);
  CHECK(two.say("Q:") == "         0,         0,K,K,R\r\n");
  CHECK(one.say("Q:") == "         0,K,K,R\r\n");
  CHECK(two.say("A:1-P400") == "OK\r\n");
  CHECK(two.say("G:") == "OK\r\n");
  CHECK(two.say("!:") == "B\r\n");
  CHECK(two.say("Q:").size() == 29);
  two.wait();
  CHECK(two.say("!:") == "R\r\n");
  CHECK(two.say("Q:") == "-      400,         0,K,K,R\r\n");
}

TEST_CASE("a SHOT queues a move, starts it when told, and says NG to what it does not understand") {
  Controller shot("shot");
  CHECK(shot.say("G:") == "NG\r\n");  // Nothing is queued.
  CHECK(shot.say("Q:") == "         0,         0,X,K,R\r\n");
  CHECK(shot.say("A:1+P1000") == "OK\r\n");
  CHECK_FALSE(shot.device->mechanics().moving(shot.now_s));
  CHECK(shot.say("L:1") == "OK\r\n");  // A stop takes what is queued with it.
  CHECK(shot.say("G:") == "NG\r\n");
  CHECK(shot.say("M:1+P1000") == "OK\r\n");
  CHECK(shot.say("M:1+P30") == "OK\r\n");  // The last one counts.
  CHECK(shot.say("G") == "OK\r\n");
  shot.wait();
  CHECK(shot.device->mechanics().position_units(shot.now_s) == 30);
  for (const char* wrong : {"A:1P5", "A:1+5", "A:3+P5", "A:1+P", "A:1+P99999999999", "X:1", "D:1S500",
                            "D:1S500F50R200", "L:3", "H:", "?:X", "a:1+P5", "A1+P5", "A:1+P5 ", "C:12"})
    CHECK(shot.say(wrong) == "NG\r\n");
  CHECK(shot.say("D:1S500F5000R200") == "OK\r\n");
  CHECK(shot.say("D:WS100F1000R200S100F1000R200") == "OK\r\n");
  CHECK(shot.say("A:W+P5-P7") == "OK\r\n");
  CHECK(shot.say("G:") == "OK\r\n");
  shot.wait();
  CHECK(shot.say("Q:") == "         5,-        7,K,K,R\r\n");
  CHECK(shot.say("A:1-P0") == "OK\r\n");  // How some clients write zero.
  CHECK(shot.say("?:N") == "SHOT-302GS\r\n");
  CHECK(shot.say("R:1") == "OK\r\n");
  CHECK(shot.say("Q:") == "         0,-        7,K,K,R\r\n");
}

TEST_CASE("while a SHOT moves it answers questions and heeds stops, and nothing else") {
  Controller shot("shot");
  shot.say("A:1+P100000");
  shot.say("G:");
  shot.now_s += 1;
  for (const char* refused : {"A:1+P5", "G:", "R:1", "D:1S500F5000R200", "H:1", "C:10"})
    CHECK(shot.say(refused) == "NG\r\n");
  CHECK(shot.say("!:") == "B\r\n");
  CHECK(shot.say("L:1") == "OK\r\n");
  CHECK(shot.device->mechanics().moving(shot.now_s));  // It slows down first.
  shot.wait();
  CHECK(shot.device->mechanics().position_units(shot.now_s) < 10000);
  shot.say("H:1");
  CHECK(shot.say("L:1") == "OK\r\n");  // Homing does not heed it.
  CHECK(shot.device->mechanics().homing(shot.now_s));
  CHECK(shot.say("L:E") == "OK\r\n");
  CHECK_FALSE(shot.device->mechanics().moving(shot.now_s));
}

TEST_CASE("a SHOT homes by way of the limit switch and counts from there") {
  Controller shot("shot");
  CHECK(shot.say("H:1") == "OK\r\n");
  CHECK(shot.device->mechanics().moving(shot.now_s + 0.2));
  shot.wait();
  CHECK(shot.say("Q:") == "         0,         0,K,K,R\r\n");
  CHECK(shot.device->mechanics().homed(shot.now_s));
  CHECK(shot.now_s > 2 * 1000 / 5000.0);
}

TEST_CASE("a limit switch stops a SHOT, and its status says which until the next motion") {
  Controller shot("shot");
  shot.options.physics.min_deg = -2.5;
  shot.device = sim::make_stage_device(shot.options);
  shot.say("A:1-P5000");
  shot.say("G:");
  shot.wait();
  CHECK(shot.say("Q:") == "-     1000,         0,K,L,R\r\n");
  shot.say("A:1+P0");
  shot.say("G:");
  shot.wait();
  CHECK(shot.say("Q:") == "         0,         0,K,K,R\r\n");
}

TEST_CASE("a GSC-02 answers questions only, knows no absolute moves, and homes in a direction") {
  Controller gsc("gsc");
  CHECK(gsc.say("M:1+P400").empty());
  CHECK(gsc.say("G").empty());
  gsc.wait();
  CHECK(gsc.say("Q:") == "       400,         0,K,K,R\r\n");
  CHECK(gsc.say("A:1+P5").empty());
  CHECK(gsc.say("Q:") == "       400,         0,X,K,R\r\n");
  CHECK(gsc.say("D:2S500F5000R200S500F5000R200").empty());
  CHECK(gsc.say("Q:") == "       400,         0,K,K,R\r\n");
  CHECK(gsc.say("D:1S500F5000R200S500F5000R200").empty());  // The slow range ends at 200 pulses/s.
  CHECK(gsc.say("D:2S500F25000R200").empty());
  CHECK(gsc.say("Q:") == "       400,         0,X,K,R\r\n");
  CHECK(gsc.say("?:N").empty());
  CHECK(gsc.say("H:1").empty());
  CHECK_FALSE(gsc.device->mechanics().moving(gsc.now_s));
  CHECK(gsc.say("H:1-").empty());
  CHECK(gsc.say("!:") == "B\r\n");
  gsc.wait();
  CHECK(gsc.say("Q:") == "         0,         0,K,K,R\r\n");
  CHECK(gsc.say("C:10").empty());
  CHECK(gsc.say("M:1+P5").empty());  // The motor is free: refused without a word.
  CHECK(gsc.say("Q:") == "         0,         0,X,K,R\r\n");
  CHECK(gsc.say("ACK:1") == "OK\r\n");
  CHECK(gsc.say("G:") == "NG\r\n");
}

TEST_CASE("a command to a SHOT ends with CR LF, wherever it is cut, and noise is not obeyed") {
  Controller shot("shot");
  std::string out;
  for (const char c : std::string("Q:\r\n!:\r\n")) out += shot.device->receive(std::string(1, c), 0);
  CHECK(out == "         0,         0,K,K,R\r\nR\r\n");
  CHECK(shot.device->receive("Q:\n", 0).empty());
  CHECK(shot.device->receive("\r\n", 0) == "NG\r\n");  // What came before belongs to it.
  CHECK(shot.device->receive("\r\n", 0).empty());
  CHECK(shot.device->receive(std::string(100000, 'A') + "\r\n", 0).empty());
  CHECK(shot.say("!:") == "R\r\n");
}

TEST_CASE("a Falcon answers lines that end with LF, in degrees with two decimals") {
  Controller falcon("falcon");
  const auto ask = [&](const std::string& text) { return falcon.device->receive(text + "\n", falcon.now_s); };
  CHECK(ask("F#") == "FR_OK\n");
  CHECK(ask("FV") == "FV:1.3\n");
  CHECK(ask("FA") == "FR_OK:72000:180.00:0:0:0:0\n");
  CHECK(ask("MD:12.34") == "MD:12.34\n");
  falcon.now_s += 1;
  CHECK(ask("FA").substr(ask("FA").size() - 9) == ":1:0:0:0\n");
  CHECK(ask("FH") == "FH:1\n");
  falcon.wait();
  CHECK(ask("MD:12.34") == "MD:12.34\n");
  falcon.wait();
  CHECK(ask("FA") == "FR_OK:4936:12.34:0:0:0:0\n");
  CHECK(ask("FD") == "FD:12.34\n");
  CHECK(ask("FN:1") == "FN:1\n");
  CHECK(ask("FA") == "FR_OK:4936:347.66:0:0:0:1\n");
  CHECK(ask("FN:0") == "FN:0\n");
  CHECK(ask("SD:90.00") == "SD:90.00\n");
  CHECK(ask("FD") == "FD:90.00\n");
  for (const char* wrong : {"MD:", "MD:-5", "MD:361", "MD:1e3", "MD:1.2.3", "XX", ""})
    CHECK(ask(wrong).empty());
}

TEST_CASE("a SHOT tells the settings that its clients ask for") {
  Controller shot("shot"), one("shot", 1);
  CHECK(shot.say("?:SW") == "2,2\r\n");
  CHECK(shot.say("S:1100") == "OK\r\n");
  CHECK(shot.say("?:SW") == "100,2\r\n");
  CHECK(shot.say("?:S1") == "100\r\n");
  CHECK(shot.say("D:2S100F1000R50") == "OK\r\n");
  CHECK(shot.say("?:DW") == "S500F5000R200S100F1000R50\r\n");
  CHECK(shot.say("V:1S100F2000R50") == "OK\r\n");
  CHECK(shot.say("?:B1") == "S100F2000R50\r\n");
  CHECK(shot.say("?:PW") == "0.0025,0.0025\r\n");
  CHECK(shot.say("I:") == "0\r\n");
  CHECK(shot.say("O:1") == "OK\r\n");
  CHECK(one.say("?:SW") == "2\r\n");
  CHECK(one.say("?:N") == "GIP-101\r\n");
  CHECK(Controller("gsc", 1).say("?:N") == "GSC-01\r\n");
  for (const char* wrong : {"?:S3", "?:X1", "?:DWW", "O:2"}) CHECK(shot.say(wrong) == "NG\r\n");
}

}  // namespace stage_shot_test
