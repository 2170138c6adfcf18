// SPDX-License-Identifier: MIT
#include "tests/support/runner_rig.hpp"

namespace runner_prompts_test {

using Catch::Matchers::Contains;
using namespace runner_rig;

TEST_CASE("a prompt is asked again until the rig sees what was asked for") {
  Rig rig(
      "  - home\n"
      "  - prompt: {title: Place it, place: {target: board, shift_mm: 100}, until: {beams_deg: [-1, "
      "1], "
      "within_mm: "
      "[1450, 1550]}}\n"
      "  - capture: {samples: 5, target: board}\n");
  rig.person.answers = [&](const rig::Prompt& prompt) {
    if (!prompt.check.empty()) rig.world.board_mm = 1500;
    return rig::Answer{};
  };
  rig.run();
  CHECK(rig.person.asked.size() == 2);
  CHECK(rig.captures()[0].range == 1500);
  CHECK(rig.captures()[0].shift_mm == 100);
}

TEST_CASE(
    "a prompt that places a target is done when the target is seen there, and says what is seen instead") {
  Rig rig(
      "  - home\n  - prompt: {title: Place it, place: {target: board, at_mm: 1600}}\n"
      "  - capture: {samples: 5, target: board}\n");
  std::vector<std::string> refused;
  rig.person.nobody = false;
  rig.person.answers = [&](const rig::Prompt& prompt) {
    refused.push_back(prompt.refusal);
    if (refused.size() == 3) rig.world.board_mm = 1600;
    return rig::Answer{};
  };
  CHECK(rig.run());
  REQUIRE(refused.size() == 3);
  CHECK(refused[0].empty());
  CHECK_THAT(refused[1], Contains("'board' is not in its place") && Contains("nearer than asked") &&
                             Contains("instead of 1600 mm"));
  CHECK(rig.captures()[0].range == 1600);
}

TEST_CASE("beams that a prompt waits for are asked besides the place of its target, not instead") {
  for (const double board_mm : {1400, 1600}) {
    CAPTURE(board_mm);
    Rig rig(
        "  - home\n  - prompt: {title: Place it, place: {target: board, at_mm: 1600}, until: {beams_deg: "
        "[-1, "
        "1], within_mm: [1300, 1500]}}\n");
    rig.world.board_mm = board_mm;
    CHECK_THROWS_WITH(rig.run(),
                      Contains(board_mm == 1400 ? "'board' is not in its place" : "expected 1300 to 1500"));
  }
}

TEST_CASE("beams that a prompt names are judged where it was asked, not where its target is seen later") {
  Rig rig(
      "  - prompt: {title: Place it, place: {target: board, at_mm: 1600}, until: {beams_deg: [88, 92], "
      "within_mm: [900, 1100]}}\n"
      "  - home\n  - capture: {samples: 5, target: board}\n");
  rig.world.board_mm = 1600;
  rig.lidar.tamper = [&](lidar::Scan& scan) {
    constexpr int at_80_deg = 540 + 320;
    for (int step = std::max(scan.first_step, at_80_deg); step <= scan.last_step; ++step)
      scan.range_mm[static_cast<std::size_t>(step - scan.first_step)] = rig.stage.homed ? 2500 : 1000;
  };
  CHECK(rig.run());
  CHECK(rig.captures().size() == 1);
}

TEST_CASE("an unattended run ends where a target is not in place, without having measured it") {
  Rig placed(
      "  - home\n  - prompt: {title: Place it, place: {target: board, at_mm: 5000}}\n"
      "  - capture: {samples: 5, target: board}\n");
  CHECK_THROWS_WITH(placed.run(),
                    Contains("instead of 5000 mm") && Contains("Unattended run: cannot be corrected"));
  CHECK(placed.captures().empty());
  // One that no prompt places is looked at before the first capture.
  Rig standing("  - home\n  - capture: {samples: 5, target: board}\n");
  standing.world.board_mm = 1800;
  CHECK_THROWS_WITH(standing.run(), Contains("'board' is not in its place") && Contains("farther away"));
  CHECK(standing.captures().empty());
  standing.world.board_mm = 1400;
  CHECK(standing.run());
}

TEST_CASE(
    "where the bench file is in question, what is not seen in its place is reported and measured all the "
    "same") {
  Rig standing("  - home\n  - capture: {samples: 5, target: board}\n");
  standing.doubts_bench = true;
  standing.world.board_mm = 1800;
  std::string warned;
  standing.prepare = [&](rig::Runner& runner) {
    runner.observe([&](const rig::RunState& state) {
      for (const auto& message : state.messages)
        if (message.level == "warning") warned = message.text;
    });
  };
  CHECK(standing.run());
  CHECK_THAT(warned, Contains("'board' is not in its place") && Contains("farther away"));
  CHECK(standing.captures()[0].range == 1800);
  // At a prompt: said once, and a second confirmation counts.
  Rig placed(
      "  - home\n  - prompt: {title: Place it, place: {target: board, at_mm: 1600}}\n"
      "  - capture: {samples: 5, target: board}\n");
  placed.doubts_bench = true;
  placed.person.nobody = false;
  std::vector<std::string> refused;
  placed.person.answers = [&](const rig::Prompt& prompt) {
    refused.push_back(prompt.refusal);
    return rig::Answer{};
  };
  CHECK(placed.run());
  REQUIRE(refused.size() == 2);
  CHECK_THAT(refused[1], Contains("instead of 1600 mm") && Contains("confirm again"));
  CHECK(placed.captures()[0].range == placed.world.board_mm);
}

TEST_CASE("a target that stood in its place before an interruption is looked at before the run goes on") {
  Rig rig(
      "  - home\n  - prompt: {title: Place it, place: {target: board, at_mm: 1600}}\n"
      "  - capture: {samples: 5, target: board}\n  - capture: {samples: 5, target: board}\n");
  rig.world.board_mm = 1600;
  rig.lidar.before_scan = [&](std::uint64_t number) { rig.lidar.dead = number >= 32; };
  CHECK_THROWS(rig.run());
  REQUIRE(rig.captures().size() >= 1);
  rig.lidar.dead = false;
  rig.lidar.before_scan = [](std::uint64_t) {};
  rig.world.board_mm = 1400;
  CHECK_THROWS_WITH(rig.run(), Contains("instead of 1600 mm"));
  rig.world.board_mm = 1600;
  CHECK(rig.run());
}

TEST_CASE(
    "a surface whose echo does not follow its stated reflectance is reported, unless the procedure says "
    "otherwise") {
  const auto steps = [](const std::string& until) {
    return "  - home\n  - for-each: {r: [0.9, 0.2]}\n    steps:\n"
           "      - prompt: {title: Place it, place: {target: board, shift_mm: 0, reflectance: "
           "'${r}'}" +
           until + "}\n      - capture: {samples: 5, target: board}\n";
  };
  Rig same(steps(""));
  CHECK_THROWS_WITH(same.run(), Contains("its echo is 2000") && Contains("0.2 is requested"));
  CHECK(same.captures().size() == 1);
  Rig changed(steps(""));
  changed.lidar.tamper = [&](lidar::Scan& scan) {
    if (changed.person.asked.size() > 1) scan.intensity.assign(scan.intensity.size(), 700);
  };
  CHECK(changed.run());
  Rig unasked(steps(", until: {surface: false}"));
  CHECK(unasked.run());
}

TEST_CASE("a or q at a prompt stops the run") {
  Rig rig("  - home\n  - prompt: {title: Place it}\n  - capture: {samples: 5}\n");
  rig.person.nobody = false;
  rig.person.answers = [&](const rig::Prompt&) {
    rig::Answer answer;
    answer.kind = rig::Answer::Kind::abort;
    return answer;
  };
  CHECK_THROWS_AS(rig.run(), rig::RunStopped);
  CHECK(rig.person.asked.size() == 1);
  CHECK(rig.stage.stops >= 1);
  rig.person.answers = [](const rig::Prompt&) { return rig::Answer{}; };
  CHECK(rig.run());
}

TEST_CASE("an answer out of its range is reported with the range") {
  Rig rig("  - home\n  - prompt: {title: Measure it, ask: {name: rail, unit: mm, min: 150, max: 400}}\n");
  std::vector<std::string> refused;
  rig.person.nobody = false;
  rig.person.answers = [&](const rig::Prompt& prompt) {
    refused.push_back(prompt.refusal);
    rig::Answer answer;
    answer.value = refused.size() == 1 ? 900.0 : 300.0;
    return answer;
  };
  CHECK(rig.run());
  CHECK(refused == std::vector<std::string>{"", "900 mm is outside 150 to 400 mm."});
}

TEST_CASE("a number with a decimal comma or a unit is refused with the number as it should be written") {
  Rig rig("  - home\n  - prompt: {title: Measure it, ask: {name: rail, unit: mm}}\n");
  std::vector<std::string> refused;
  const std::vector<std::string> typed = {"1300,5", "1300.5 mm", "1,300.5", "twelve"};
  rig.person.nobody = false;
  rig.person.answers = [&](const rig::Prompt& prompt) {
    refused.push_back(prompt.refusal);
    rig::Answer answer;
    answer.value = 1.0;
    if (refused.size() <= typed.size()) answer.value = typed[refused.size() - 1];
    return answer;
  };
  CHECK(rig.run());
  const std::string plain = "the answer must be a number in mm";
  const std::string hint = plain + ": write 1300.5, with a decimal point and without a unit.";
  CHECK(refused == std::vector<std::string>{"", hint, hint, plain + ".", plain + "."});
}

TEST_CASE("captures know how long the lidar has been on once a prompt has said so, in a resumed run too") {
  Rig rig(
      "  - home\n  - capture: {samples: 5}\n"
      "  - prompt: {title: Switch it off and on, place: {since_power_on_s: 30}}\n"
      "  - capture: {samples: 5}\n  - wait: {seconds: 100}\n  - capture: {samples: 50}\n");
  rig.lidar.before_scan = [&](std::uint64_t number) { rig.lidar.dead = number >= 60; };
  CHECK_THROWS(rig.run());
  CHECK(rig.lidar.connects >= 2);  // Who was switched off is connected to anew, and that is no fault.
  CHECK(rig.reported("the lidar was switched off and on"));
  rig.lidar.dead = false;
  rig.lidar.before_scan = [](std::uint64_t) {};
  CHECK(rig.run());
  const auto captures = rig.captures();
  REQUIRE(captures.size() == 3);
  CHECK_FALSE(captures[0].since_power_on_s);
  REQUIRE(captures[1].since_power_on_s);
  REQUIRE(captures[2].since_power_on_s);
  CHECK(*captures[1].since_power_on_s == Approx(30).margin(1));
  const auto passed_s = static_cast<double>(captures[2].stamps[0] - captures[1].stamps[0]) / 1e3;
  CHECK(*captures[2].since_power_on_s - *captures[1].since_power_on_s == Approx(passed_s).margin(1));
}

TEST_CASE("nobody is asked for ever: a bench that contradicts the captures ends the run") {
  Rig rig(
      "  - home\n  - prompt: {title: Place it, until: {beams_deg: [-1, 1], within_mm: [1450, "
      "1550]}}\n");
  CHECK_THROWS_WITH(rig.run(), Contains("sees 1400 mm") && Contains("expected 1450 to 1550"));
}

TEST_CASE(
    "while a person works, the rig tells what it sees, and a lidar that was unplugged meanwhile comes back") {
  Rig rig(
      "  - home\n  - prompt: {title: Place it, place: {target: board, at_mm: 1500}, until: "
      "{beams_deg: [-1, 1], "
      "within_mm: [1450, 1550]}}\n"
      "  - capture: {samples: 5}\n");
  rig.person.nobody = false;
  rig.person.silent = true;
  std::vector<std::string> wrong;
  rig.lidar.before_scan = [&](std::uint64_t number) { rig.lidar.dead = rig.lidar.dead || number == 60; };
  rig.prepare = [&](rig::Runner& runner) {
    runner.observe([&](const rig::RunState& state) {
      if (!state.prompt) return;
      if (!state.prompt->check.empty()) wrong.push_back(state.prompt->check);
      if (rig.lidar.dead && state.prompt->check.find("does not answer") != std::string::npos) {
        rig.lidar.dead = false;
        rig.world.board_mm = 1500;
      }
      if (!state.prompt->seen.empty() && state.reconnects == 1) runner.answer(rig::Answer{});
    });
  };
  CHECK(rig.run());
  REQUIRE_FALSE(wrong.empty());
  CHECK_THAT(wrong.front(), Contains("'board' is not in its place") && Contains("instead of 1500 mm"));
  CHECK(rig.reported("lidar lost"));
  CHECK(rig.reported("lidar is back"));
  REQUIRE(rig.captures().size() == 1);
  CHECK(rig.captures()[0].range == 1500);
  CHECK(rig.captures()[0].stamps.size() == 5);
}

TEST_CASE("skipping a prompt skips the rest of its turn only") {
  Rig rig(
      "  - home\n"
      "  - for-each: {d: [1, 2, 3]}\n"
      "    steps:\n"
      "      - prompt: {title: 'Place ${d}'}\n"
      "      - capture: {samples: 5}\n"
      "        name: 'at ${d}'\n");
  rig.person.answers = [](const rig::Prompt& prompt) {
    rig::Answer answer;
    if (prompt.title == "Place 2") answer.kind = rig::Answer::Kind::skipped;
    return answer;
  };
  rig.run();
  const auto captures = rig.captures();
  REQUIRE(captures.size() == 2);
  CHECK(captures[0].step == "at 1");
  CHECK(captures[1].step == "at 3");
}

TEST_CASE("a repeated turn is measured again and the first measurement is kept under another name") {
  Rig rig(
      "  - home\n"
      "  - for-each: {d: [1, 2]}\n"
      "    steps:\n"
      "      - prompt: {title: 'Place ${d}'}\n"
      "      - capture: {samples: 5}\n"
      "        name: 'at ${d}'\n");
  bool repeated = false;
  rig.person.answers = [&](const rig::Prompt& prompt) {
    rig::Answer answer;
    if (prompt.title == "Place 2" && !std::exchange(repeated, true)) answer.kind = rig::Answer::Kind::repeat;
    return answer;
  };
  rig.run();
  const auto captures = rig.captures();
  REQUIRE(captures.size() == 3);
  CHECK_THAT(captures[0].step, Contains("(repeated)"));
  CHECK(captures[1].step == "at 1");
  CHECK(captures[2].step == "at 2");
}

}  // namespace runner_prompts_test
