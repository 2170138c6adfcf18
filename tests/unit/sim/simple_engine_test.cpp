// SPDX-License-Identifier: MIT
#include "sim/simple_engine.hpp"

#include <catch2/catch.hpp>
#include <cmath>

namespace simple_engine_test {
namespace {

fit::Bench edge_bench() {
  return fit::parse_bench(R"j({"schema": "bench/1", "lidar": {"mount": {"x_mm": 5, "y_mm": -3}},
    "targets": [{"name": "board", "from_mm": [1500, -2000], "to_mm": [1500, 0], "reflectance": 0.8},
                {"name": "back", "from_mm": [2300, -4000], "to_mm": [2300, 4000], "reflectance": 0.4}]})j");
}

struct Scan {
  explicit Scan(sim::SimpleEngine& engine, double stage_rad = 0, double rate = 0)
      : range(1081), intensity(1081) {
    engine.scan(
        10,
        [&](double t) {
          return sim::StageMoment{stage_rad + rate * (t - 10), rate};
        },
        range, intensity);
  }
  std::vector<std::uint32_t> range, intensity;
};

sim::SimpleOptions quiet() {
  sim::SimpleOptions options;
  options.sigma_mm = 0;
  options.relative_intensity_noise = 0;
  return options;
}

}  // namespace

TEST_CASE("the simulated range is the distance along the beam from the optical centre to the wall") {
  sim::SimpleEngine engine(edge_bench(), quiet(), 1);
  for (const double stage : {0.0, 0.3, -0.2}) {
    const Scan scan(engine, stage);
    for (const int step : {200, 400, 500, 600}) {
      const double direction = stage + (step - 540) * 0.25 * fit::rad_per_deg;
      const double ox = 5 * std::cos(stage) + 3 * std::sin(stage),
                   oy = 5 * std::sin(stage) - 3 * std::cos(stage);
      double expected = (1500 - ox) / std::cos(direction);
      const double y = oy + expected * std::sin(direction);
      if (y > 0 || y < -2000) expected = (2300 - ox) / std::cos(direction);
      INFO(stage << " " << step);
      if (std::cos(direction) > 0 && std::abs(oy + expected * std::sin(direction)) < 4000)
        CHECK(scan.range[static_cast<std::size_t>(step)] == Approx(expected).margin(0.51));
    }
  }
}

TEST_CASE("a round target is as far away as its circle is, dims towards its sides and moves as it is told") {
  fit::Bench bench = edge_bench();
  fit::Target post;
  post.name = "post";
  post.set_round({{600, 800}, 150});  // its middle is 1000 mm away, in direction atan2(800, 600)
  post.reflectance = 0.8;
  bench.targets.push_back(post);
  bench.lidar.mount = {fit::Estimate{0}, fit::Estimate{0}, fit::Estimate{0}};
  sim::SimpleOptions options = quiet();
  options.edge_window_rad = 0;
  sim::SimpleEngine engine(bench, options, 1);
  for (const double shift : {0.0, 200.0}) {
    engine.set_scene({"post", shift, 0.8});
    const Scan scan(engine);
    for (const double off_deg : {-8.0, -4.0, 0.0, 2.0, 6.0}) {
      const double towards_deg = std::atan2(800, 600) * fit::deg_per_rad;
      const auto step = static_cast<std::size_t>(540 + std::lround((towards_deg + off_deg) * 4));
      const double off = (static_cast<double>(step) - 540) / 4 * fit::rad_per_deg - std::atan2(800, 600);
      const double aside = (1000 + shift) * std::sin(off);
      INFO("shifted by " << shift << " mm, " << off_deg << " deg aside");
      if (std::abs(aside) > 150) {
        CHECK((scan.range[step] > 2300 || scan.range[step] == 65533));  // what is behind it
        continue;
      }
      CHECK(scan.range[step] ==
            Approx((1000 + shift) * std::cos(off) - std::sqrt(150 * 150 - aside * aside)).margin(0.51));
      const auto middle = static_cast<std::size_t>(540 + std::lround(towards_deg * 4));
      CHECK(scan.intensity[step] ==
            Approx(scan.intensity[middle] * std::sqrt(1 - std::pow(aside / 150, 2))).epsilon(0.03));
    }
  }
}

TEST_CASE("a beam with nothing before it reports no echo") {
  sim::SimpleEngine engine(edge_bench(), quiet(), 1);
  CHECK(Scan(engine).range[0] == 65533);
}

TEST_CASE("at an edge a beam sees both surfaces within the window and one outside of it") {
  sim::SimpleEngine engine(edge_bench(), quiet(), 7);
  const double edge = std::atan2(3.0, 1495.0);  // the board ends at y = 0, the optical centre is at (5, -3)
  for (const double off_deg : {-0.03, -0.02, 0.0, 0.02, 0.03}) {
    // the stage brings beam 540 to `off_deg` beyond the edge; a small turn hardly moves the optical centre
    int back = 0;
    for (int i = 0; i < 400; ++i) back += Scan(engine, edge + off_deg * fit::rad_per_deg).range[540] > 2000;
    INFO(off_deg);
    if (off_deg < -0.025)
      CHECK(back == 0);
    else if (off_deg > 0.026)
      CHECK(back == 400);
    else
      CHECK((back > 0 && back < 400));
  }
}

TEST_CASE("noise has the size it was given and a seed repeats it") {
  sim::SimpleOptions options;
  options.sigma_mm = 8;
  sim::SimpleEngine a(edge_bench(), options, 42), b(edge_bench(), options, 42), c(edge_bench(), options, 43);
  double sum = 0, squares = 0;
  bool same = true, other = true;
  for (int i = 0; i < 2000; ++i) {
    const double range = Scan(a).range[500];
    same = same && range == Scan(b).range[500];
    other = other && range == Scan(c).range[500];
    sum += range;
    squares += range * range;
  }
  CHECK(same);
  CHECK(!other);
  const double variance = squares / 2000 - sum * sum / 4e6;
  CHECK(variance == Approx(64 + 1 / 12.0).epsilon(0.12));
}

TEST_CASE("the echo weakens with distance, slant and darkness") {
  sim::SimpleEngine engine(edge_bench(), quiet(), 1);
  const Scan scan(engine);
  CHECK(scan.intensity[500] > scan.intensity[700]);  // the board before the darker background
  CHECK(scan.intensity[530] > scan.intensity[350]);  // square on before a slant
  sim::SceneState darker;
  darker.target = "board";
  darker.reflectance = 0.2;
  darker.target_shift_mm = 100;
  engine.set_scene(darker);
  const Scan changed(engine);
  CHECK(changed.intensity[500] < scan.intensity[500] / 3);
  CHECK(changed.range[540 - 20] - scan.range[540 - 20] == Approx(100).margin(2));
}

TEST_CASE("when the stage turns, each beam is fired from where the stage is at its own time") {
  sim::SimpleEngine engine(edge_bench(), quiet(), 1);
  const double rate = 40 * fit::rad_per_deg;
  const Scan turning(engine, -0.1, rate);
  // Beam 400 is fired 400/1440 of a turn after the stamp.
  const Scan standing(engine, -0.1 + rate * 0.025 * 400 / 1440);
  CHECK(turning.range[400] == standing.range[400]);
}

TEST_CASE("a beam of a turning stage sees what it would see standing there, in a crowded room too") {
  const fit::Bench room =
      fit::parse_bench(R"j({"schema": "bench/1", "lidar": {"mount": {"x_mm": 12, "y_mm": -7, "yaw_deg": 3}},
    "targets": [{"name": "east", "from_mm": [3000, -2000], "to_mm": [2400, 2200]},
                {"name": "north", "from_mm": [2400, 2200], "to_mm": [-2500, 2200]},
                {"name": "west", "from_mm": [-2500, 2200], "to_mm": [-2500, -2000]},
                {"name": "board", "from_mm": [1400, 500], "to_mm": [1400, 0]},
                {"name": "crossing", "from_mm": [1300, 100], "to_mm": [2000, 700]},
                {"name": "post", "centre_mm": [900, -500], "radius_mm": 120},
                {"name": "near", "from_mm": [-40, 30], "to_mm": [40, 40]}]})j");
  sim::SimpleOptions options = quiet();
  options.edge_window_rad = 0;  // otherwise chance decides at edges
  sim::SimpleEngine turning(room, options, 1), standing(room, options, 1);
  for (const double rate : {0.3, -5.0, 40.0}) {
    const Scan scan(turning, 0.7, rate);
    for (std::size_t step = 0; step < scan.range.size(); step += 3) {
      const double stage = 0.7 + rate * ((10 + room.lidar.beam_time_s(static_cast<double>(step))) - 10);
      const Scan expected(standing, stage);
      INFO(rate << " rad/s, step " << step);
      REQUIRE(scan.range[step] == expected.range[step]);
      REQUIRE(scan.intensity[step] == expected.intensity[step]);
    }
  }
}

}  // namespace simple_engine_test
