// SPDX-License-Identifier: MIT
// What holds for a stage of any language; what is particular to Zaber is in stage_zaber_test.cpp.
#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <boost/asio/steady_timer.hpp>
#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>

#include "rig/errors.hpp"
#include "rig/stage/stage_guard.hpp"
#include "sim/random.hpp"
#include "tests/support/stage_rig.hpp"

namespace stage_languages_test {

using Catch::Matchers::Contains;

namespace {

/// As a bench with the usual zero sees the table.
double bench_deg(const StageRig& rig) {
  return rig.true_deg() - sim::usual_stage_zero_deg(rig.device_options.language);
}

/// Runs a move that is expected to fail, and does something once the stage moves.
template <class Disturb>
std::string why_failed(StageRig& rig, double target_deg, Disturb disturb) {
  std::string why;
  bool is_over = false;
  boost::asio::co_spawn(rig.io, rig.stage->move_to(target_deg), [&](std::exception_ptr failure, double) {
    try {
      if (failure) std::rethrow_exception(failure);
    } catch (const std::exception& error) {
      why = error.what();
    }
    is_over = true;
  });
  const double from_deg = rig.true_deg();
  while (!is_over && std::abs(rig.true_deg() - from_deg) < 2)
    rig.io.run_one_for(std::chrono::milliseconds(10));
  disturb();
  rig.pump(is_over);
  return why;
}

}  // namespace

TEST_CASE("a stage of any language homes, goes where it is sent and reads back where it is") {
  const std::string language = GENERATE("zaber", "shot", "gsc", "falcon");
  INFO(language);
  StageRig rig(language);
  rig.open();
  const rig::StageIdentity identity = rig.run(rig.stage->identify());
  CHECK(identity.language == language);
  const double unit_deg = 1 / identity.units_per_deg;
  rig.run(rig.stage->home());
  CHECK(rig.run(rig.stage->status()).homed);
  for (const double target : {12.34, -7.5, 0.29, -0.01, 0.0, 90.0}) {
    const double angle = rig.run(rig.stage->move_to(target));
    CHECK(std::abs(angle - target) < unit_deg / 2 + 1e-9);
    CHECK(bench_deg(rig) == Approx(angle).margin(1e-9));
  }
  // A hundred steps of a hundredth of a degree do not drift.
  for (int i = 0; i <= 100; ++i) rig.run(rig.stage->move_to(-0.5 + 0.01 * i));
  CHECK(std::abs(bench_deg(rig) - 0.5) < unit_deg / 2 + 1e-9);
}

TEST_CASE("a stage of any language that counts clockwise is commanded counter-clockwise") {
  const std::string language = GENERATE("zaber", "shot", "gsc", "falcon");
  INFO(language);
  StageRig rig(language);
  rig.options.direction = -1;
  rig.open();
  rig.run(rig.stage->home());
  CHECK(rig.run(rig.stage->move_to(30)) == Approx(30));
  CHECK(bench_deg(rig) == Approx(-30));
}

TEST_CASE("no language moves a stage beyond its soft limits, or before it is homed") {
  const std::string language = GENERATE("zaber", "shot", "gsc", "falcon");
  INFO(language);
  StageRig rig(language);
  rig.options.min_deg = -10;
  rig.options.max_deg = 20;
  rig.open();
  if (language != "falcon") {  // It keeps its zero without power.
    CHECK_FALSE(rig.run(rig.stage->status()).homed);
    CHECK_THROWS_WITH(rig.run(rig.stage->move_to(1)), Contains("has not been homed"));
  }
  rig.run(rig.stage->home());
  CHECK_THROWS_WITH(rig.run(rig.stage->move_to(20.5)), Contains("soft limits"));
  CHECK(rig.run(rig.stage->move_to(20)) == Approx(20));
}

TEST_CASE("a stage of any language that is found moving is stopped when it is opened") {
  const std::string language = GENERATE("zaber", "shot", "gsc", "falcon");
  INFO(language);
  StageRig rig(language, 1);
  rig.switch_on();
  const double target = rig.device->mechanics().position_units(rig.clock.now_s()) + 100000;
  rig.device->mechanics().move_to(rig.clock.now_s(), target);
  rig.open();
  CHECK_FALSE(rig.device->mechanics().moving(rig.clock.now_s()));
  CHECK(rig.device->mechanics().position_units(rig.clock.now_s()) < target);
  const auto reported = [&] {
    const rig::StageStatus status = rig.run(rig.stage->status());
    return std::ranges::any_of(status.warnings,
                               [](const auto& w) { return w.starts_with("it was found moving"); });
  };
  CHECK(reported());
  CHECK_FALSE(reported());
}

TEST_CASE("stop goes before a waiting move in any language") {
  const std::string language = GENERATE("zaber", "shot", "gsc", "falcon");
  INFO(language);
  StageRig rig(language, 1, true);
  rig.options.needs_homing = false;
  rig.open();
  bool is_stopped = false;
  const std::string why = why_failed(rig, 90, [&] {
    boost::asio::co_spawn(rig.io, rig.stage->stop(), [&](std::exception_ptr failure) {
      CHECK_FALSE(failure);
      is_stopped = true;
    });
  });
  rig.pump(is_stopped);
  CHECK_THAT(why, Contains("was stopped"));
  CHECK_FALSE(rig.device->mechanics().moving(rig.clock.now_s()));
  CHECK(bench_deg(rig) < 45);
}

TEST_CASE("in any language a motion that ends early is an error, and the next one is right") {
  const std::string language = GENERATE("zaber", "shot", "gsc", "falcon");
  INFO(language);
  StageRig rig(language);
  rig.open();
  rig.run(rig.stage->home());
  const auto fail = [&](sim::StageFault fault) {
    const double from_deg = bench_deg(rig);
    return why_failed(rig, from_deg > 0 ? -60 : 60, [&] { rig.device->inject(fault, rig.clock.now_s()); });
  };
  const auto recover = [&] {
    rig.run(rig.stage->stop());
    if (!rig.run(rig.stage->status()).homed) rig.run(rig.stage->home());
    CHECK(rig.run(rig.stage->move_to(5)) == Approx(5).margin(1e-3));
    CHECK(bench_deg(rig) == Approx(5).margin(1e-3));
  };
  CHECK_THAT(fail(sim::StageFault::stall), Contains("stalled"));
  recover();
  CHECK_THAT(fail(sim::StageFault::limit_switch), Contains("limit switch"));
  recover();
  CHECK_FALSE(fail(sim::StageFault::power_cycle).empty());
  recover();
  rig.options.reply_s = 0.05;
  rig.device->inject(sim::StageFault::dead, rig.clock.now_s());
  CHECK_THROWS_AS(rig.run(rig.stage->move_to(2)), rig::StageLost);
}

TEST_CASE("lost and late answers and lost commands do not lead a stage astray in any language") {
  const std::string language = GENERATE("zaber", "shot", "gsc", "falcon");
  INFO(language);
  StageRig rig(language);
  rig.options.reply_s = 0.05;
  rig.open();
  rig.run(rig.stage->home());
  sim::Random random(5);
  rig.port->set_line_fault([&](sim::PtyPort::Direction direction, const std::string& bytes) {
    sim::PtyPort::Passage passage(bytes);
    if (random.uniform() < 0.08) passage.bytes.clear();
    if (direction == sim::PtyPort::Direction::to_device) return passage;
    if (random.uniform() < 0.05) passage.delay_s = 0.08;
    if (random.uniform() < 0.2) passage.split = true;
    return passage;
  });
  int failures = 0;
  for (int i = 1; i <= 6; ++i) {
    double angle = NAN;
    for (int attempt = 0; attempt < 4 && std::isnan(angle); ++attempt) {
      try {
        if (!rig.run(rig.stage->status()).homed) rig.run(rig.stage->home());
        angle = rig.run(rig.stage->move_to(i));
      } catch (const rig::StageError&) {
        ++failures;
      }
    }
    CHECK(angle == Approx(i).margin(1e-3));
    CHECK(bench_deg(rig) == Approx(i).margin(1e-3));
  }
  CHECK(failures < 3);
}

TEST_CASE("what is no answer in the stage's language is shown, with baud rate and device as likely causes") {
  const std::string language = GENERATE("zaber", "shot", "gsc", "falcon", "");
  INFO(language);
  StageRig rig(language.empty() ? "zaber" : language);
  rig.options.language = language;
  rig.options.reply_s = 0.05;
  rig.switch_on();
  rig.port->set_line_fault([](sim::PtyPort::Direction direction, const std::string& bytes) {
    sim::PtyPort::Passage passage(bytes);
    if (direction != sim::PtyPort::Direction::to_device) passage.bytes = "\x81k\"\xFE";
    return passage;
  });
  std::string why;
  try {
    rig.open();
  } catch (const rig::StageError& error) {
    why = error.what();
  }
  CHECK_THAT(why, Contains(R"("\x81k\x22\xFE)") && Contains(" baud. ") && Contains("another baud rate") &&
                      Contains("another device"));
  CHECK_THAT(why, !Contains("did not answer") && !Contains("is switched on"));
  rig.port->set_line_fault({});
  rig.open();
  CHECK(rig.run(rig.stage->identify()).language == (language.empty() ? "zaber" : language));
  rig.port->set_line_fault(
      [](sim::PtyPort::Direction, const std::string&) { return sim::PtyPort::Passage(""); });
  CHECK_THROWS_WITH(rig.run(rig.stage->status()), Contains("did not answer"));
}

TEST_CASE("a noise byte in a stage's name is asked away, and never becomes its name") {
  StageRig rig("shot");
  rig.options.language = GENERATE("shot", "");
  rig.switch_on();
  bool spoilt = false;
  rig.port->set_line_fault([&](sim::PtyPort::Direction direction, const std::string& bytes) {
    sim::PtyPort::Passage passage(bytes);
    const bool is_name = direction == sim::PtyPort::Direction::to_client && bytes.starts_with("SHOT");
    if (is_name && !std::exchange(spoilt, true)) passage.bytes.insert(2, "\xFE");
    return passage;
  });
  rig.open();
  CHECK(spoilt);
  const std::string model = rig.run(rig.stage->identify()).model;
  CHECK(model.starts_with("SHOT"));
  CHECK(std::ranges::all_of(model, [](char c) { return c >= ' ' && c <= '~'; }));
}

TEST_CASE("a slow stage is found by who states how slow it is, and the search says what it waits for") {
  StageRig rig("zaber");
  rig.options.language = "";
  rig.switch_on();
  rig.port->set_line_fault([](sim::PtyPort::Direction direction, const std::string& bytes) {
    sim::PtyPort::Passage passage(bytes);
    if (direction == sim::PtyPort::Direction::to_client) passage.delay_s = 0.2;
    return passage;
  });
  CHECK_THROWS_WITH(rig.open(), Contains("waits 0.15 s") && Contains("`reply_s`"));
  rig.options.reply_s = 0.8;
  rig.open();
  CHECK(rig.run(rig.stage->identify()).language == "zaber");
}

TEST_CASE("a stage that is asked in another language than its own says nothing: the told language is named") {
  StageRig rig("gsc");  // It answers nothing that it does not know.
  rig.options.language = "zaber";
  rig.options.reply_s = 0.05;
  rig.switch_on();
  std::string why;
  try {
    rig.open();
  } catch (const rig::StageError& error) {
    why = error.what();
  }
  CHECK_THAT(why, Contains("did not answer `get deviceid`") && Contains("language 'zaber'") &&
                      Contains("without `language`"));
  rig.options.language.clear();
  rig.open();
  CHECK(rig.run(rig.stage->identify()).language == "gsc");
}

TEST_CASE("a stage of any language is found again after it was unplugged") {
  const std::string language = GENERATE("shot", "gsc", "falcon");
  INFO(language);
  StageRig rig(language);
  rig.port_options.link =
      (std::filesystem::temp_directory_path() / ("stage_" + language + std::to_string(::getpid()))).string();
  rig.open();
  rig.run(rig.stage->home());
  CHECK(rig.run(rig.stage->move_to(3)) == Approx(3));
  rig.port->unplug();
  CHECK_THROWS_AS(rig.run(rig.stage->move_to(4)), rig::StageLost);
  CHECK_THROWS_WITH(rig.run(rig.stage->reopen()),
                    Contains("if it still turns") && !Contains("Nothing was moved"));
  rig.port->replug();
  rig.run(rig.stage->reopen());
  // A SHOT or GSC may have lost its power as well, and would not say so.
  CHECK(rig.run(rig.stage->status()).homed == (language == "falcon"));
  rig.run(rig.stage->home());
  CHECK(rig.run(rig.stage->move_to(4)) == Approx(4));
}

TEST_CASE("a stage whose port comes back under another name is stopped all the same") {
  const std::string language = GENERATE("zaber", "shot", "gsc", "falcon");
  INFO(language);
  StageRig rig(language, 1, true);
  rig.options.needs_homing = false;
  rig.port_options.link =
      (std::filesystem::temp_directory_path() / ("stop_" + language + std::to_string(::getpid()))).string();
  rig.open();
  const std::string why = why_failed(rig, 90, [&] { rig.port->unplug(); });
  CHECK_THAT(why, Contains("is lost"));
  boost::asio::steady_timer plugging(rig.io, std::chrono::milliseconds(500));
  plugging.async_wait([&](const boost::system::error_code&) { rig.port->replug(); });
  rig.run(rig.stage->stop());
  CHECK_FALSE(rig.device->mechanics().moving(rig.clock.now_s()));
  CHECK(bench_deg(rig) < 89);
}

TEST_CASE("every language is found by asking") {
  const std::string language = GENERATE("zaber", "shot", "gsc", "falcon");
  INFO(language);
  StageRig rig(language);
  rig.switch_on();
  const auto found = rig.run(rig::probe_stage(rig.io.get_executor(), rig.port->path()));
  REQUIRE(found.identity);
  CHECK(found.identity->language == language);
  CHECK_FALSE(rig.device->mechanics().moving(rig.clock.now_s()));
}

TEST_CASE("a turn at a given rate goes on until it is stopped, and a Falcon says that it has none") {
  const std::string language = GENERATE("zaber", "shot", "gsc", "falcon");
  INFO(language);
  StageRig rig(language, 1);
  rig.options.needs_homing = false;
  rig.open();
  if (language == "falcon") {
    CHECK_THROWS_WITH(rig.run(rig.stage->turn(2)), Contains("has no speed"));
    return;
  }
  rig.run(rig.stage->turn(2));
  const double units_per_deg = rig.run(rig.stage->identify()).units_per_deg;
  while (rig.true_deg() < 1) rig.run(rig.stage->status());
  CHECK(rig.device->mechanics().rate_units_s(rig.clock.now_s()) / units_per_deg == Approx(2).epsilon(1e-3));
  rig.run(rig.stage->stop());
  CHECK_FALSE(rig.device->mechanics().moving(rig.clock.now_s()));
}

// --- the guard ---

namespace {

/// A program of its own that holds the port, says that the stage moves, and then is killed or hangs.
pid_t guarded_program(const std::string& path, bool hangs) {
  const pid_t child = ::fork();
  if (child != 0) return child;
  const int port = ::open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK);
  rig::StageGuard guard(port, "\n/1 1 stop\n", hangs ? 0.2 : 60);
  guard.moving();
  for (;;) ::pause();
}

void expect_stop_after(bool hangs) {
  StageRig rig("zaber", 1, true);
  rig.switch_on();
  rig.device->mechanics().turn(rig.clock.now_s(), 4000);
  const pid_t child = guarded_program(rig.port->path(), hangs);
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(10);
  boost::asio::steady_timer head_start(rig.io, std::chrono::milliseconds(100));
  head_start.async_wait([&](const boost::system::error_code&) {
    if (!hangs) ::kill(child, SIGKILL);
  });
  while (rig.device->mechanics().moving(rig.clock.now_s()) && std::chrono::steady_clock::now() < end)
    rig.io.run_one_for(std::chrono::milliseconds(20));
  CHECK_FALSE(rig.device->mechanics().moving(rig.clock.now_s()));
  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
}

}  // namespace

TEST_CASE("a moving stage is stopped when the program that moves it is killed") { expect_stop_after(false); }

TEST_CASE("a moving stage is stopped when the program that moves it hangs") { expect_stop_after(true); }

TEST_CASE("a stage that is forgotten while it moves is stopped, and its port is free again at once") {
  StageRig rig("zaber", 1, true);
  rig.options.needs_homing = false;
  rig.open();
  rig.run(rig.stage->turn(1));
  CHECK(rig.device->mechanics().moving(rig.clock.now_s()));
  rig.stage.reset();
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(5);
  while (rig.device->mechanics().moving(rig.clock.now_s()) && std::chrono::steady_clock::now() < end)
    rig.io.run_one_for(std::chrono::milliseconds(20));
  CHECK_FALSE(rig.device->mechanics().moving(rig.clock.now_s()));
  rig.open();
}

}  // namespace stage_languages_test
