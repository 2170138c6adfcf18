// SPDX-License-Identifier: MIT
#include "rig/session/targets_in_view.hpp"

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

namespace targets_in_view_test {

TEST_CASE("targets stand in the lidar's frame, turned and moved by stage and mount") {
  const fit::Bench bench = fit::parse_bench(R"({"schema": "bench/1",
    "lidar": {"mount": {"x_mm": 100, "y_mm": 0, "yaw_deg": 0}},
    "targets": [{"name": "board", "from_mm": [1400, -200], "to_mm": [1400, 200]}]})");
  CHECK(rig::targets_in_view(bench, 0) == nlohmann::json::parse("[[[1300, -200], [1300, 200]]]"));
  CHECK(rig::targets_in_view(bench, 90) == nlohmann::json::parse("[[[-300, -1400], [100, -1400]]]"));
}

}  // namespace targets_in_view_test
