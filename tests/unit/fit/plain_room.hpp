// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "fit/bench.hpp"
#include "plain_bench.hpp"
#include "synthetic_recording.hpp"

/// A room of four walls, one of them askew, in which mechanisms are tried.
namespace plain_bench {

inline const std::vector<Wall> room{{{2600, -1900}, {2300, 3100}},
                                    {{2300, 3100}, {-1700, 3100}},
                                    {{-1700, 3100}, {-1700, -1900}},
                                    {{-1700, -1900}, {2600, -1900}}};

/// The room in a bench file; `lidar` are the fields of the lidar besides its rate, `sigma_mm` its known
/// noise.
inline fit::Bench bench_of_room(const std::string& lidar, const std::string& sigma_mm) {
  return fit::parse_bench(R"({"schema": "bench/1", "lidar": {"scan_hz": 40, )" + lidar + R"(}, "targets": [
    {"name": "east", "from_mm": [2600, -1900], "to_mm": [2300, 3100], "u_mm": 1.5, "u_deg": 0.1},
    {"name": "north", "from_mm": [2300, 3100], "to_mm": [-1700, 3100], "u_mm": 1.5, "u_deg": 0.1},
    {"name": "west", "from_mm": [-1700, 3100], "to_mm": [-1700, -1900], "u_mm": 1.5, "u_deg": 0.1},
    {"name": "south", "from_mm": [-1700, -1900], "to_mm": [2600, -1900], "u_mm": 1.5, "u_deg": 0.1}],
    "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": )" +
                          sigma_mm + "}}]}");
}

/// 16 stops in one turn, of 271 beams and 12 scans each.
inline void record_all_round(SyntheticRecording& recording) {
  for (int i = 0; i < 16; ++i) {
    fit::CaptureInfo capture;
    capture.stage_rad = 22.5 * i * degree;
    capture.approach = 1;
    capture.last_step = 270;
    capture.since_power_on_s = 100 + 20 * i;
    recording.add(capture, 12);
  }
}

}  // namespace plain_bench
