// SPDX-License-Identifier: MIT
// The example of docs/develop/lidar.md, as a user runs it, beside rig-sim.
#include <catch2/catch.hpp>
#include <cstdio>
#include <fstream>

#include "tests/support/programs.hpp"

namespace print_scans_test {

using Catch::Matchers::Contains;

TEST_CASE("the example prints scans with this computer's times") {
  const TestFolder folder;
  std::ofstream(folder / "bench.json") << R"({"schema": "bench/1", "targets": [
    {"name": "board", "from_mm": [1400, -500], "to_mm": [1400, 500]}]})";
  SimProgram sim(folder, folder / "bench.json", {"--speed", "real"});
  const std::string address = sim.lidar(), port = address.substr(address.rfind(':') + 1);
  const auto steady_s = [] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  };
  const double begun_s = steady_s();
  Program example({RIG_BINARY_DIR "/tests/print_scans", "127.0.0.1", port, "5"}, folder);
  double before_s = begun_s;
  for (int i = 0; i < 5; ++i) {
    const auto line = example.line();
    INFO(example.errors());
    REQUIRE(line);
    double at_s = 0, u_us = 0;
    unsigned long long device_ms = 0;
    unsigned beams = 0, ahead_mm = 0;
    REQUIRE(std::sscanf(line->c_str(), "%lf s (+- %lf us), lidar's clock %llu ms, %u beams, ahead %u mm",
                        &at_s, &u_us, &device_ms, &beams, &ahead_mm) == 5);
    CHECK(at_s > before_s);
    CHECK(at_s < steady_s());
    CHECK(u_us < 5000);
    CHECK(beams == 1081);
    CHECK(ahead_mm == Approx(1400).margin(60));
    before_s = at_s;
  }
  CHECK(example.exit_status() == 0);

  Program nobody({RIG_BINARY_DIR "/tests/print_scans", "127.0.0.1", "1"}, folder);
  CHECK(nobody.exit_status() == 3);
  CHECK_THAT(nobody.errors(), Contains("nothing listens"));
}

}  // namespace print_scans_test
