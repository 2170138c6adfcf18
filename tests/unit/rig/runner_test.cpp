// SPDX-License-Identifier: MIT
#include "tests/support/runner_rig.hpp"

namespace runner_test {

using Catch::Matchers::Contains;
using namespace runner_rig;

TEST_CASE("a capture holds exactly the scans and beams that were asked for") {
  Rig rig("  - home\n  - capture: {samples: 25, beams_deg: [-10, -5]}\n");
  CHECK(rig.run());
  const auto captures = rig.captures();
  REQUIRE(captures.size() == 1);
  CHECK(captures[0].stamps.size() == 25);
  CHECK(captures[0].beams == 21);
  CHECK(rig.stage.stops >= 1);
}

TEST_CASE("a for-each that comes to a value again measures there again") {
  Rig rig(
      "  - home\n  - for-each: {at_deg: [-5, 0, 5, 0]}\n    steps:\n      - move: {to_deg: \"${at_deg}\"}\n"
      "      - capture: {samples: 3}\n");
  CHECK(rig.run());
  const auto captures = rig.captures();
  REQUIRE(captures.size() == 4);
  CHECK(captures[3].stage_deg == 0);
  CHECK(captures[3].approach == captures[1].approach);  // from the procedure's side, from wherever it came
}

TEST_CASE("an abort stops the stage, keeps what was captured and says how to go on") {
  Rig rig("  - home\n  - capture: {samples: 500}\n");
  rig.prepare = [&](rig::Runner& runner) {
    rig.lidar.before_scan = [&](std::uint64_t number) {
      if (number == 100) runner.abort();
    };
  };
  CHECK_THROWS_AS(rig.run(), rig::RunStopped);
  CHECK(rig.stage.stops >= 1);
  CHECK(rig.lidar.stops >= 1);
  REQUIRE(rig.captures().size() == 1);
  CHECK_THAT(rig.captures()[0].step, Contains("(short)"));
}

TEST_CASE("a pause holds the run at the next checkpoint until it is resumed") {
  Rig rig("  - home\n  - sweep: {start_deg: 0, stop_deg: 1, step_deg: 0.5, samples: 3}\n");
  bool paused = false;
  rig.prepare = [&](rig::Runner& runner) {
    rig.lidar.before_scan = [&](std::uint64_t number) {
      if (number == 14) runner.pause();
    };
    runner.observe([&](const rig::RunState& state) {
      if (state.phase != rig::RunState::Phase::paused || std::exchange(paused, true)) return;
      runner.resume();
    });
  };
  rig.run();
  CHECK(paused);
  CHECK(rig.captures().size() == 3);
}

TEST_CASE("an edge is found with its window, and again from the same captures when resumed") {
  const std::string steps =
      "  - home\n  - find-edge: {target: board, beam_deg: 0, samples: 60}\n"
      "  - move: {to_deg: '${edge_smooth_deg}'}\n  - capture: {samples: 5}\n";
  Rig whole(steps);
  // The board's right end, (1400, -200), is seen by beam 0 at -8.13 deg.
  whole.world.edge_deg = -8.2;
  whole.run();
  const double smooth_deg = whole.captures().back().stage_deg;
  CHECK(smooth_deg == Approx(-8.2 + 0.025).margin(0.0101));

  Rig broken(steps);
  broken.world.edge_deg = -8.2;
  broken.lidar.before_scan = [&](std::uint64_t number) { broken.lidar.dead = number >= 400; };
  CHECK_THROWS(broken.run());
  broken.lidar.dead = false;
  broken.lidar.before_scan = [](std::uint64_t) {};
  broken.run();
  CHECK(broken.captures().back().stage_deg == Approx(smooth_deg).margin(0.0101));
}

TEST_CASE("the edge's window is found although the surface behind is slanted") {
  Rig rig(
      "  - home\n  - find-edge: {target: board, beam_deg: 0, samples: 60, search_deg: 3}\n"
      "  - move: {to_deg: '${edge_background_deg}'}\n  - capture: {samples: 5}\n");
  rig.world.edge_deg = -8.2;
  rig.world.slant_mm_per_deg = 15;
  rig.run();
  CHECK(rig.captures().back().stage_deg == Approx(-8.2 - 0.025).margin(0.0101));
}

TEST_CASE("samples may be spaced out in time") {
  Rig rig("  - home\n  - capture: {samples: 10, spacing_s: 0.5}\n");
  rig.run();
  const auto stamps = rig.captures()[0].stamps;
  for (std::size_t i = 1; i < stamps.size(); ++i) CHECK(stamps[i] - stamps[i - 1] == 500);
}

}  // namespace runner_test
