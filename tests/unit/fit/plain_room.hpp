// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "fit/bench/bench.hpp"
#include "plain_bench.hpp"
#include "synthetic_recording.hpp"

/// A room of four walls, one of them askew, in which mechanisms are tried.
namespace plain_bench {

inline const std::vector<Wall> room{{{2600, -1900}, {2300, 3100}},
                                    {{2300, 3100}, {-1700, 3100}},
                                    {{-1700, 3100}, {-1700, -1900}},
                                    {{-1700, -1900}, {2600, -1900}}};

/// Four walls in a bench file; `lidar` are the fields of the lidar besides its rate, `sigma_mm` its known
/// noise.
inline fit::Bench bench_of_walls(const std::vector<Wall>& walls, const std::string& lidar,
                                 const std::string& sigma_mm) {
  std::string targets;
  const std::vector<std::string> names{"east", "north", "west", "south"};
  const auto place = [](Point at) {
    return "[" + std::to_string(std::lround(at.real())) + ", " + std::to_string(std::lround(at.imag())) + "]";
  };
  for (std::size_t i = 0; i < names.size(); ++i)
    targets += std::string(i == 0 ? "" : ", ") + R"({"name": ")" + names[i] + R"(", "from_mm": )" +
               place(walls.at(i).from) + R"(, "to_mm": )" + place(walls.at(i).to) +
               R"(, "u_mm": 1.5, "u_deg": 0.1})";
  return fit::parse_bench(
      R"({"schema": "bench/1", "lidar": {"scan_hz": 40, )" + lidar + R"(}, "targets": [)" + targets +
      R"(], "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": )" + sigma_mm + "}}]}");
}

inline fit::Bench bench_of_room(const std::string& lidar, const std::string& sigma_mm) {
  return bench_of_walls(room, lidar, sigma_mm);
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
