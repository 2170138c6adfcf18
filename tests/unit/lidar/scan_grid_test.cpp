// SPDX-License-Identifier: MIT
#include "lidar/scan_grid.hpp"

#include <catch2/catch.hpp>
#include <cmath>

namespace scan_grid_test {

TEST_CASE("starts of scans are found within their uncertainty, periods of almost whole milliseconds too") {
  for (const double period_ms : {25.0, 25.00001, 25.0001, 25.001, 25.0123, 24.97, 33.1 + 1.0 / 30, 50.0}) {
    lidar::ScanGrid grid(std::round(period_ms));
    for (int i = 1; i < 20'000; ++i) {
      const double start_ms = 3.3 + period_ms * i;
      const auto found = grid.add(static_cast<std::uint64_t>(start_ms));
      INFO(period_ms << " ms, scan " << i << ", u " << found.u_ms);
      REQUIRE(found.u_ms < 0.5);
      // The start is anywhere in what the stamps allow: mostly within sqrt(3) uncertainties from its
      // middle.
      REQUIRE(std::abs(found.device_ms - start_ms) < 5 * found.u_ms + 2e-4);
    }
  }
}

}  // namespace scan_grid_test
