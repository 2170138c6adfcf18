// SPDX-License-Identifier: MIT
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>
#include <string>

#include "fit/explain/explanation.hpp"
#include "synthetic_recording.hpp"

namespace explain_clusters_test {
namespace {

/// A wall seen 60 deg to either side by a lidar with plain noise, which merges steps as SCIP lidars do: the
/// nearest range of a cluster is sent.
class Wall {
 public:
  explicit Wall(int clustered_captures, int single_captures) : recording_(bench(), maker()) {
    fit::CaptureInfo capture;
    capture.last_step = 120;
    for (int i = 0; i < single_captures; ++i) recording_.add(capture, 60);
    capture.cluster = 4;  // of 121 steps the last cluster holds one
    for (int i = 0; i < clustered_captures; ++i) recording_.add(capture, 60);
  }
  [[nodiscard]] fit::explain::Explanation explained() const {
    return fit::explain::explain({&recording_}, {});
  }

 private:
  static fit::Bench bench() {
    return fit::parse_bench(R"({"schema": "bench/1", "lidar": {"steps": 121, "front_step": 60, "step_deg": 1,
      "scan_hz": 40}, "targets": [{"name": "wall", "from_mm": [1500, -4000], "to_mm": [1500, 4000], "u_mm": 3,
      "u_deg": 0.1}],
      "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": {"value": 8, "u": 0.2}}}]})");
  }
  static SyntheticRecording::Maker maker() {
    return [random = std::mt19937(5)](const fit::CaptureInfo& capture, std::int64_t,
                                      std::vector<std::uint16_t>& range,
                                      std::vector<std::uint16_t>& intensity) mutable {
      std::normal_distribution<double> noise(0, 8);
      for (std::size_t k = 0; k < range.size(); ++k) {
        double nearest = 1e9;
        for (int step = static_cast<int>(k) * capture.cluster;
             step < std::min((static_cast<int>(k) + 1) * capture.cluster, 121); ++step)
          nearest = std::min(nearest, 1500 / std::cos((step - 60) * fit::rad_per_deg) + noise(random));
        range[k] = static_cast<std::uint16_t>(std::lround(nearest));
        intensity[k] = 800;
      }
    };
  }
  SyntheticRecording recording_;
};

}  // namespace

TEST_CASE("a value of a cluster stands for the middle of its steps, the last cluster's for what there is") {
  fit::CaptureInfo capture;
  capture.first_step = 10, capture.last_step = 20, capture.cluster = 4;
  REQUIRE(capture.beams() == 3);
  CHECK(capture.step_of(0) == 11.5);
  CHECK(capture.step_of(1) == 15.5);
  CHECK(capture.step_of(2) == 19);
  capture.cluster = 1;
  CHECK(capture.step_of(3) == 13);
}

TEST_CASE("captures in clusters are told, left out, and blamed on no physics") {
  const fit::explain::Explanation explanation = Wall(3, 4).explained();
  CHECK(explanation.verdict == "nothing-missing");
  REQUIRE_FALSE(explanation.notes.empty());
  CHECK(explanation.notes.front().find("3 captures were left out") != std::string::npos);
}

TEST_CASE("a recording of clusters alone is not explained") {
  CHECK_THROWS_WITH(Wall(3, 0).explained(), Catch::Contains("cluster: 1"));
}

}  // namespace explain_clusters_test
