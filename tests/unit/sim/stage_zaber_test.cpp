// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <string>

#include "sim/stage_device.hpp"

namespace stage_zaber_test {
namespace {

struct Zaber {
  explicit Zaber(bool homed = false) {
    options.physics = sim::usual_stage_physics("zaber");
    options.homed = homed;
    device = sim::make_stage_device(options);
  }
  std::string say(const std::string& text) { return device->receive(text + "\n", now_s); }
  void wait() {
    while (device->mechanics().moving(now_s)) now_s += 0.01;
    device->poll(now_s);
  }

  sim::StageDeviceOptions options;
  std::unique_ptr<sim::StageDevice> device;
  double now_s = 0;
};

std::string with_sum(const std::string& text) {
  unsigned sum = 0;
  for (const char c : text) sum += static_cast<unsigned char>(c);
  const char* digits = "0123456789ABCDEF";
  sum = (256 - sum % 256) % 256;
  return text + ":" + digits[sum / 16] + digits[sum % 16];
}

}  // namespace

TEST_CASE("a Zaber reply without id has its blanks where strict clients look for them") {
  Zaber zaber;
  for (const char* command : {"/", "/1", "/01 0 ", "/1 1", "/get deviceid", "/1 1 get pos", "/1 home"}) {
    const std::string reply = zaber.say(command);
    INFO(command << " -> " << reply);
    REQUIRE(reply.size() > 18);
    CHECK(reply.starts_with("@01 "));
    for (const std::size_t blank : {3U, 5U, 8U, 13U, 16U}) CHECK(reply[blank] == ' ');
    CHECK(reply.ends_with("\r\n"));
    CHECK(reply.find(':') == std::string::npos);
  }
}

TEST_CASE("a Zaber echoes an id with two digits if it was given one, and sums only when told") {
  Zaber zaber;
  CHECK(zaber.say("/1 1 42 get pos") == "@01 1 42 OK IDLE WR 0\r\n");
  CHECK(zaber.say("/1 1 7 get pos") == "@01 1 07 OK IDLE WR 0\r\n");
  CHECK(zaber.say("/" + with_sum("1 0 01 get deviceid")) == "@01 0 01 OK IDLE WR 50000\r\n");
  CHECK(zaber.say("/1 0 1 get deviceid:00").empty());  // A wrong sum: no answer.
  CHECK(zaber.say("/2 1 get pos").empty());            // Not its address.
  CHECK(zaber.say("/set comm.checksum 1") == "@" + with_sum("01 0 OK IDLE WR 0") + "\r\n");
  CHECK(zaber.say("/1 1 get pos") == "@" + with_sum("01 1 OK IDLE WR 0") + "\r\n");
}

TEST_CASE("a Zaber rejects with the reason that identifying clients expect") {
  Zaber zaber(true);
  CHECK(zaber.say("/1 1 get no.such.setting") == "@01 1 RJ IDLE -- BADCOMMAND\r\n");
  CHECK(zaber.say("/1 0 storage get zaber.label") == "@01 0 RJ IDLE -- BADDATA\r\n");
  CHECK(zaber.say("/1 2 get pos") == "@01 2 RJ IDLE -- BADAXIS\r\n");
  CHECK(zaber.say("/1 1 move abs 999999999") == "@01 1 RJ IDLE -- BADDATA\r\n");
  CHECK(zaber.say("/1 1 move abs x") == "@01 1 RJ IDLE -- BADDATA\r\n");
  CHECK(zaber.say("/1 1 dance") == "@01 1 RJ IDLE -- BADCOMMAND\r\n");
  for (const char* setting : {"deviceid", "system.serial", "version", "version.build", "device.hw.modified",
                              "system.axiscount", "resolution", "peripheralid"})
    CHECK(zaber.say(std::string("/1 0 get ") + setting).find(" OK ") != std::string::npos);
}

TEST_CASE("a Zaber accepts a motion before it ends, tells when it stands, and notes what was interrupted") {
  Zaber zaber(true);
  CHECK(zaber.say("/1 1 move abs 10000") == "@01 1 OK BUSY -- 0\r\n");
  zaber.now_s += 0.02;
  CHECK(zaber.say("/1 1") == "@01 1 OK BUSY -- 0\r\n");
  CHECK(zaber.say("/1 1 move rel 500").find(" OK BUSY ") != std::string::npos);
  zaber.wait();
  CHECK(zaber.say("/1 1").find("IDLE") != std::string::npos);
  zaber.say("/1 1 warnings clear");
  CHECK(zaber.say("/1 1 warnings") == "@01 1 OK IDLE -- 00\r\n");
  zaber.say("/1 1 set comm.alert 1");
  CHECK(zaber.say("/set comm.alert 1").find(" OK ") != std::string::npos);
  zaber.say("/1 1 home");
  zaber.now_s += 0.01;
  CHECK(zaber.say("/1 1 stop").find(" OK ") != std::string::npos);
  while (zaber.device->mechanics().moving(zaber.now_s)) zaber.now_s += 0.01;
  CHECK(zaber.device->poll(zaber.now_s).starts_with("!01 1 IDLE "));
}

TEST_CASE("a Zaber that lost its power has no reference, and a stall is reported until the next motion") {
  Zaber zaber(true);
  zaber.say("/1 1 move abs 100000");
  zaber.now_s += 0.5;
  zaber.device->inject(sim::StageFault::stall, zaber.now_s);
  CHECK(zaber.say("/1 1").find(" IDLE FS ") != std::string::npos);
  CHECK(zaber.say("/1 1 move abs 0").find(" OK BUSY -- ") != std::string::npos);
  zaber.device->inject(sim::StageFault::power_cycle, zaber.now_s);
  CHECK(zaber.say("/1 1") == "@01 1 OK IDLE WR 0\r\n");
  CHECK(zaber.say("/1 1 warnings") == "@01 1 OK IDLE WR 01 WR\r\n");
  zaber.say("/1 1 home");
  zaber.wait();
  CHECK(zaber.say("/1 1") == "@01 1 OK IDLE -- 0\r\n");
}

TEST_CASE("noise on a Zaber's line is discarded with the command it is in") {
  Zaber zaber(true);
  CHECK(zaber.say("/1 1 move\x01 abs 5").empty());
  CHECK(zaber.say("nonsense").empty());
  CHECK(zaber.say("/1 1 get pox\bs") == "@01 1 OK IDLE -- 0\r\n");
  std::string out;
  for (const char c : std::string("/1 1 get pos\r\n")) out += zaber.device->receive(std::string(1, c), 0);
  CHECK(out == "@01 1 OK IDLE -- 0\r\n");
}

}  // namespace stage_zaber_test
