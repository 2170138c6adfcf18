// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "fit/bench/bench.hpp"
#include "plain_bench.hpp"

/// A room of three walls of which most is seen at a slant, so that a range that all beams have in common
/// resembles a turn of the stage.
namespace slanted_room {

inline const std::vector<plain_bench::Wall> walls{
    {{2400, -3000}, {1100, 1500}}, {{1100, 1500}, {-2800, 1500}}, {{-2800, 1500}, {2400, -3000}}};
inline const plain_bench::Mount mount{8, 3, -20};

/// `sigma_mm`: the stated noise, as JSON. `more`: other keys of the bench file, each with a comma behind.
inline fit::Bench bench(const std::string& sigma_mm, const std::string& more = {}) {
  return fit::parse_bench(R"({"schema": "bench/1", "lidar": {"steps": 271, "front_step": 135,
    "step_deg": 1, "scan_hz": 40, "mount": {"x_mm": {"value": 8, "u": 3}, "y_mm": {"value": 3, "u": 3},
    "yaw_deg": {"value": -20, "u": 0.3}}}, )" +
                          more + R"("targets": [
    {"name": "east", "from_mm": [2400, -3000], "to_mm": [1100, 1500], "u_mm": 1.5, "u_deg": 0.1},
    {"name": "north", "from_mm": [1100, 1500], "to_mm": [-2800, 1500], "u_mm": 1.5, "u_deg": 0.1},
    {"name": "slant", "from_mm": [-2800, 1500], "to_mm": [2400, -3000], "u_mm": 1.5, "u_deg": 0.1}],
    "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": )" +
                          sigma_mm + "}}]}");
}

}  // namespace slanted_room
