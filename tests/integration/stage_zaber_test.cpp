// SPDX-License-Identifier: MIT
#include <unistd.h>

#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "rig/errors.hpp"
#include "tests/support/stage_rig.hpp"

namespace stage_zaber_test {

using Catch::Matchers::Contains;

TEST_CASE("a Zaber stage homes, moves to absolute angles and reads back where it is") {
  StageRig rig;
  rig.open();
  const rig::StageIdentity identity = rig.run(rig.stage->identify());
  CHECK(identity.language == "zaber");
  CHECK(identity.units_per_deg == Approx(1536000.0 / 360));
  CHECK_FALSE(rig.run(rig.stage->status()).homed);
  rig.run(rig.stage->home());
  CHECK(rig.run(rig.stage->status()).homed);
  const double angle = rig.run(rig.stage->move_to(12.34));
  CHECK(std::abs(angle - 12.34) < 0.5 / identity.units_per_deg + 1e-9);
  CHECK(rig.true_deg() == Approx(angle).margin(1e-9));
  // A hundred steps of a hundredth of a degree do not drift: every one is an absolute target.
  for (int i = 0; i <= 100; ++i) rig.run(rig.stage->move_to(-0.5 + 0.01 * i));
  CHECK(std::abs(rig.true_deg() - 0.5) < 0.5 / identity.units_per_deg + 1e-9);
}

TEST_CASE("a stage that counts clockwise is commanded counter-clockwise") {
  StageRig rig("zaber", sim::SimClock::max_speed, true);
  rig.options.direction = -1;
  rig.open();
  CHECK(rig.run(rig.stage->move_to(30)) == Approx(30));
  CHECK(rig.true_deg() == Approx(-30));
}

TEST_CASE("a stage that is not homed is not moved") {
  StageRig rig;
  rig.open();
  CHECK_THROWS_WITH(rig.run(rig.stage->move_to(1)),
                    Contains("has not been homed") && Contains("needs_homing"));
  CHECK_THROWS_WITH(rig.run(rig.stage->turn(1)), Contains("has not been homed"));
  CHECK(rig.true_deg() == 0);
  rig.options.needs_homing = false;
  rig.stage.reset();
  rig.open();
  CHECK(rig.run(rig.stage->move_to(1)) == Approx(1).margin(1e-3));
}

TEST_CASE("nothing is commanded beyond the soft limits") {
  StageRig rig("zaber", sim::SimClock::max_speed, true);
  rig.options.min_deg = -10;
  rig.options.max_deg = 20;
  rig.open();
  CHECK_THROWS_WITH(rig.run(rig.stage->move_to(20.01)), Contains("20.01 deg") && Contains("soft limits"));
  CHECK_THROWS_WITH(rig.run(rig.stage->move_to(std::nan(""))), Contains("not a number"));
  CHECK(rig.run(rig.stage->move_to(20)) == Approx(20));
}

TEST_CASE("a turn ends by itself at the soft limit, and the next move has its full speed again") {
  StageRig rig("zaber", sim::SimClock::max_speed, true);
  rig.options.max_deg = 20;
  rig.open();
  const double usual = rig.device->mechanics().speed();
  rig.run(rig.stage->turn(0.5));
  CHECK(rig.device->mechanics().speed() == Approx(usual * 0.5 / 20).epsilon(1e-3));
  while (rig.run(rig.stage->status()).moving) {
  }
  CHECK(rig.run(rig.stage->status()).position_deg == Approx(20));
  rig.run(rig.stage->move_to(0));
  CHECK(rig.device->mechanics().speed() == Approx(usual).epsilon(1e-3));
}

TEST_CASE("stop goes before a waiting move, which then says that it was stopped") {
  StageRig rig("zaber", 1, true);
  rig.open();
  std::string why;
  bool is_over = false;
  boost::asio::co_spawn(rig.io, rig.stage->move_to(90), [&](std::exception_ptr failure, double) {
    try {
      if (failure) std::rethrow_exception(failure);
    } catch (const rig::StageError& error) {
      why = error.what();
    }
    is_over = true;
  });
  while (!rig.run(rig.stage->status()).moving) {
  }
  rig.run(rig.stage->stop());
  rig.pump(is_over);
  CHECK_THAT(why, Contains("was stopped"));
  CHECK_FALSE(rig.device->mechanics().moving(rig.clock.now_s()));
  CHECK(rig.true_deg() < 80);
}

TEST_CASE("a stage that is found turning is stopped when it is opened") {
  StageRig rig("zaber", 1, true);
  rig.switch_on();
  rig.device->mechanics().turn(rig.clock.now_s(), 4000);
  rig.open();
  CHECK_FALSE(rig.device->mechanics().moving(rig.clock.now_s()));
}

TEST_CASE("a stall, a refusal, lost power and a silent stage each say what happened and what to do") {
  StageRig rig("zaber", 1, true);
  rig.open();
  const auto fail_during_move = [&](sim::StageFault fault) {
    std::string why;
    bool is_over = false;
    boost::asio::co_spawn(rig.io, rig.stage->move_to(rig.true_deg() + 30),
                          [&](std::exception_ptr failure, double) {
                            try {
                              if (failure) std::rethrow_exception(failure);
                            } catch (const std::exception& error) {
                              why = error.what();
                            }
                            is_over = true;
                          });
    while (!rig.device->mechanics().moving(rig.clock.now_s()))
      rig.io.run_one_for(std::chrono::milliseconds(10));
    rig.device->inject(fault, rig.clock.now_s());
    rig.pump(is_over);
    return why;
  };
  CHECK_THAT(fail_during_move(sim::StageFault::stall),
             Contains("stalled and stopped (FS)") && Contains("home it"));
  CHECK_THAT(fail_during_move(sim::StageFault::limit_switch), Contains("unexpected limit switch"));
  CHECK_THAT(fail_during_move(sim::StageFault::power_cycle),
             Contains("lost its reference") && Contains("home it"));
  rig.run(rig.stage->home());
  rig.device->inject(sim::StageFault::reject_next, rig.clock.now_s());
  CHECK_THROWS_WITH(rig.run(rig.stage->move_to(1)),
                    Contains("refused `move abs") && Contains("motor driver is off"));
  rig.device->inject(sim::StageFault::alert_storm, rig.clock.now_s());
  CHECK(rig.run(rig.stage->move_to(1)) == Approx(1).margin(1e-3));
  rig.device->inject(sim::StageFault::dead, rig.clock.now_s());
  CHECK_THROWS_AS(rig.run(rig.stage->move_to(2)), rig::StageLost);
}

TEST_CASE("replies that are lost or spoilt are asked for again, and never become an angle") {
  StageRig rig("zaber", sim::SimClock::max_speed, true);
  rig.options.reply_s = 0.05;
  rig.open();
  int count = 0;
  rig.port->set_line_fault([&](sim::PtyPort::Direction direction, const std::string& bytes) {
    ++count;
    if (direction == sim::PtyPort::Direction::to_client && count % 5 == 0) return sim::PtyPort::Passage("");
    if (direction == sim::PtyPort::Direction::to_device && count % 7 == 0) {
      std::string spoilt = bytes;
      spoilt[spoilt.size() / 2] ^= 1;  // The checksum notices.
      return sim::PtyPort::Passage(spoilt);
    }
    const bool is_reply = direction == sim::PtyPort::Direction::to_client;
    return sim::PtyPort::Passage((is_reply ? "\x01!noise" : "") + bytes);
  });
  for (int i = 1; i <= 10; ++i) CHECK(rig.run(rig.stage->move_to(i)) == Approx(i).margin(1e-3));
}

TEST_CASE("a stage that was unplugged is lost, and is found again where it is plugged in") {
  StageRig rig("zaber", sim::SimClock::max_speed, true);
  rig.port_options.link =
      (std::filesystem::temp_directory_path() / ("stage_" + std::to_string(::getpid()))).string();
  rig.open();
  CHECK(rig.run(rig.stage->move_to(3)) == Approx(3).margin(1e-3));
  const std::string before = rig.port->path();
  rig.port->unplug();
  CHECK_THROWS_AS(rig.run(rig.stage->move_to(4)), rig::StageLost);
  CHECK_THROWS_AS(rig.run(rig.stage->stop()), rig::StageLost);
  CHECK_THROWS_WITH(rig.run(rig.stage->reopen()), Contains("is not there") && Contains("plugged in"));
  rig.port->replug();
  rig.run(rig.stage->reopen());
  CHECK(rig.run(rig.stage->status()).position_deg == Approx(3).margin(1e-3));
  CHECK(rig.run(rig.stage->move_to(4)) == Approx(4).margin(1e-3));
}

TEST_CASE("the language of a stage is found by asking") {
  StageRig rig;
  rig.options.language = "";
  rig.open();
  CHECK(rig.run(rig.stage->identify()).language == "zaber");
  rig.stage.reset();
  const auto found = rig.run(rig::probe_stage(rig.io.get_executor(), rig.port->path()));
  REQUIRE(found.identity);
  CHECK(found.identity->serial == "100001");
}

TEST_CASE("a port that cannot be used says why") {
  StageRig rig;
  const auto open = [&](const std::string& url) {
    rig.run(rig::open_stage(rig.io.get_executor(), url, rig.options));
  };
  CHECK_THROWS_WITH(open("serial:/dev/no-such-port"), Contains("is not there") && Contains("rig devices"));
  CHECK_THROWS_WITH(open("serial:/dev/null"), Contains("is not a serial port"));
  CHECK_THROWS_AS(open("tcp://1.2.3.4"), rig::UsageError);
  CHECK_THROWS_WITH(open("serial:/dev/null?speeed=1"), Contains("'speeed'"));
  rig.open();
  CHECK_THROWS_WITH(open(rig.url()), Contains("in use by another program"));
}

TEST_CASE("the stage of a bench file is read strictly where the driver knows the key") {
  const rig::StageOptions options = rig::stage_options(nlohmann::json::parse(
      R"({"language": "zaber", "resolution_deg": 0.01, "limits_deg": [-170, 170], "units_per_turn": 1536000})"));
  CHECK(options.min_deg == -170);
  CHECK(options.units_per_deg == Approx(4266.667).epsilon(1e-6));
  CHECK_THROWS_WITH(rig::stage_options(nlohmann::json::parse(R"({"language": "klingon"})")),
                    Contains("zaber"));
  CHECK_THROWS_WITH(rig::stage_options(nlohmann::json::parse(R"({"direction": 0})")), Contains("1 or -1"));
  CHECK_THROWS_WITH(rig::stage_options(nlohmann::json::parse(R"({"limits_deg": [5, 1]})")),
                    Contains("smaller first"));
}

namespace {

/// Answers in the language, and refuses what it does not know: how far a turn is.
class UnknownZaber final : public sim::StageDevice {
 public:
  std::string receive(std::string_view bytes, double) override {
    std::string out;
    for (const char c : bytes) {
      line_ += c;
      if (c != '\n') continue;
      const std::string line = std::exchange(line_, "");
      const std::size_t slash = line.find('/');
      if (slash == std::string::npos) continue;
      const std::string command = line.substr(slash + 1, line.rfind(':') - slash - 1);
      const std::string who = command.substr(0, command.find("get ") - 1);
      const auto asks = [&](const char* setting) { return command.ends_with(setting); };
      const std::string answer = asks("get deviceid")           ? "OK IDLE -- 50999"
                                 : asks("get system.axiscount") ? "OK IDLE -- 1"
                                                                : "RJ IDLE -- BADCOMMAND";
      if (command.find("get ") != std::string::npos) out += "@" + who + " " + answer + "\r\n";
    }
    return out;
  }
  std::string poll(double) override { return ""; }
  sim::StageMechanics& mechanics() override { return mechanics_; }
  void inject(sim::StageFault, double) override {}
  [[nodiscard]] int baud() const override { return 115200; }

 private:
  std::string line_;
  sim::StageMechanics mechanics_{sim::usual_stage_physics("zaber")};
};

}  // namespace

TEST_CASE("a Zaber that refuses one setting is reported as that, not as another baud rate") {
  StageRig rig;
  UnknownZaber device;
  const sim::PtyPort port(rig.io.get_executor(), device, rig.clock, {});
  const rig::StageProbe found = rig.run(rig::probe_stage(rig.io.get_executor(), "serial:" + port.path()));
  CHECK_FALSE(found.identity);
  CHECK_THAT(found.why_nobody(),
             Contains("answers in the language zaber") && Contains("units_per_deg") && !Contains("baud"));
}

}  // namespace stage_zaber_test
