// SPDX-License-Identifier: MIT
#include "tests/support/runner_rig.hpp"

namespace runner_resume_test {

using Catch::Matchers::Contains;
using namespace runner_rig;

TEST_CASE("a session that says no moment at which it began is not added to") {
  Rig rig("  - home\n  - capture: {samples: 50}\n");
  rig.lidar.before_scan = [&](std::uint64_t number) { rig.lidar.dead = number >= 40; };
  CHECK_THROWS(rig.run());
  rig.lidar.dead = false;
  rig.lidar.before_scan = [](std::uint64_t) {};
  rig::SessionStore(rig.file, rig::SessionStore::Mode::append).set("epoch_unix_us", "12 o'clock");
  CHECK_THROWS_WITH(rig.run(), Contains("'12 o'clock'") && Contains("Begin a new session"));
}

TEST_CASE("a lidar that stays away ends the run safely, and a resumed run replaces the short capture") {
  Rig rig("  - home\n  - capture: {samples: 50}\n  - capture: {samples: 5}\n");
  rig.lidar.before_scan = [&](std::uint64_t number) { rig.lidar.dead = number >= 40; };
  CHECK_THROWS_WITH(rig.run(), Contains("did not come back") && Contains("rig resume"));
  CHECK(rig.stage.stops >= 1);
  auto captures = rig.captures();
  REQUIRE(captures.size() == 1);
  CHECK_THAT(captures[0].step, Contains("(short)"));
  CHECK(captures[0].stamps.size() < 50);

  rig.lidar.dead = false;
  rig.lidar.before_scan = [](std::uint64_t) {};
  rig.run();
  captures = rig.captures();
  REQUIRE(captures.size() == 2);
  CHECK(captures[0].stamps.size() == 50);
  CHECK_THAT(captures[0].step, !Contains("(short)"));
}

TEST_CASE("what was recorded is not measured again by a resumed run") {
  Rig rig(
      "  - home\n  - sweep: {start_deg: 0, stop_deg: 1, step_deg: 0.1, samples: 10}\n"
      "  - capture: {samples: 10}\n");
  rig.lidar.before_scan = [&](std::uint64_t number) { rig.lidar.dead = number >= 60; };
  CHECK_THROWS(rig.run());
  const auto before = rig.captures();
  rig.lidar.dead = false;
  rig.lidar.before_scan = [](std::uint64_t) {};
  rig.run();
  const auto after = rig.captures();
  REQUIRE(after.size() == 12);
  for (std::size_t i = 0; i + 1 < before.size(); ++i) CHECK(after[i].stamps == before[i].stamps);
  CHECK(after[11].stage_deg == 1);
}

TEST_CASE("a resumed run says how many captures are done, which step is next and with which variables") {
  Rig rig(
      "  - home\n"
      "  - for-each: {d: [1, 2]}\n"
      "    steps:\n"
      "      - prompt: {title: 'Place ${d}', ask: {name: rail, default: 7.5}}\n"
      "      - sweep: {start_deg: 0, stop_deg: 1, step_deg: 0.5, samples: 10}\n");
  rig.lidar.before_scan = [&](std::uint64_t) { rig.lidar.dead = rig.stage.moves.size() >= 7; };
  CHECK_THROWS(rig.run());
  REQUIRE(rig.captures().size() >= 4);
  rig.lidar.dead = false;
  rig.lidar.before_scan = [](std::uint64_t) {};
  CHECK(rig.run());
  CHECK(rig.reported("resumed: 4 of 6 captures are done; next is step 5 of 5, sweep"));
  CHECK(rig.reported(", with d = 2, rail = 7.5"));
  CHECK(rig.run());
  CHECK(rig.reported("resumed: all 6 captures and all 5 steps are done already"));
}

TEST_CASE("a resumed run refuses another stage, before it is moved") {
  Rig rig("  - home\n  - capture: {samples: 5}\n  - capture: {samples: 5}\n");
  rig.stage.serial = "1";
  rig.lidar.before_scan = [&](std::uint64_t number) { rig.lidar.dead = number >= 25; };
  CHECK_THROWS(rig.run());
  rig.lidar.dead = false;
  rig.lidar.before_scan = [](std::uint64_t) {};
  rig.stage.serial = "2";
  rig.stage.homed = false;
  CHECK_THROWS_WITH(rig.run(), Contains("another stage (test 2)") && Contains("(test 1)"));
  CHECK_FALSE(rig.stage.homed);
  rig.stage.serial = "1";
  CHECK(rig.run());
}

TEST_CASE("a resumed run refuses another procedure") {
  Rig rig("  - home\n  - capture: {samples: 5}\n");
  rig.run();
  rig.text += "  - capture: {samples: 6}\n";
  CHECK_THROWS_WITH(rig.run(), Contains("differs from the procedure"));
}

TEST_CASE("a resumed run with other variables is refused, and which differ is reported") {
  Rig rig("  - home\n  - capture: {samples: '${samples}'}\n", "variables: {samples: 5, far: 2}\n");
  rig.run();
  {
    rig::SessionStore(rig.file, rig::SessionStore::Mode::append)
        .set("variables", R"({"samples": 7, "far": 2})");
  }
  CHECK_THROWS_WITH(rig.run(), Contains("samples was 7 and is 5 now") && !Contains("far"));
}

}  // namespace runner_resume_test
