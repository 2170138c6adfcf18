// SPDX-License-Identifier: MIT
#include <Eigen/Geometry>
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "fit/explain/scene/scene.hpp"

namespace explain_turned_wall_test {

TEST_CASE("a wall of a room may be turned so far that its corners move by its neighbours' length past them") {
  const fit::Bench bench =
      fit::parse_bench(R"({"schema": "bench/1", "lidar": {"model": "UST-10LX"}, "targets": [
    {"name": "east", "from_mm": [4800, -3300], "to_mm": [4800, 2000], "u_mm": 1},
    {"name": "north", "from_mm": [4800, 2000], "to_mm": [-1850, 2000], "u_mm": 1},
    {"name": "west", "from_mm": [-1850, 2000], "to_mm": [-1850, -3300], "u_mm": 1},
    {"name": "south", "from_mm": [-1850, -3300], "to_mm": [4800, -3300], "u_mm": 1}]})");
  constexpr std::size_t south = 3;
  for (const double turn_deg : {-5.0, -1.0, 0.0, 2.0, 5.0}) {
    fit::explain::Nuisance nuisance(bench);
    nuisance.targets[south].turn_rad = turn_deg * fit::rad_per_deg;
    const fit::explain::Scene scene(bench, nuisance, {});
    for (double beam_deg = -179.9; beam_deg < 180; beam_deg += 0.3) {
      // From inside a convex room a beam meets the plane that is nearest before it.
      const Eigen::Vector2d ray(std::cos(beam_deg * fit::rad_per_deg), std::sin(beam_deg * fit::rad_per_deg));
      double nearest = 1e9;
      for (std::size_t i = 0; i < bench.targets.size(); ++i) {
        const fit::Target& wall = bench.targets[i];
        const Eigen::Vector2d middle = (wall.from_mm + wall.to_mm) / 2;
        const Eigen::Vector2d normal =
            Eigen::Rotation2D<double>(nuisance.targets[i].turn_rad) * wall.outward_normal();
        const double far = normal.dot(middle) / normal.dot(ray);
        if (far > 0) nearest = std::min(nearest, far);
      }
      INFO("turned by " << turn_deg << " deg, beam at " << beam_deg << " deg");
      CHECK(scene.look(0, beam_deg * fit::rad_per_deg).range_mm == Approx(nearest).margin(1e-6));
    }
  }
}

}  // namespace explain_turned_wall_test
