// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <chrono>
#include <iostream>

#include "causal_support.hpp"

using namespace causal_test;

TEST_CASE("scratch") {
  for (double d : {200., 500., 1000., 2000., 4000., 8000., 9800.})
    for (double rho : {1.0, 0.5, 0.1}) {
      auto r = record(wall_at(d, rho), 400);
      auto& c = r.at(0);
      std::cout << d << " rho " << rho << " n " << c.ranges.size();
      if (c.ranges.size() > 2) std::cout << " mean " << c.mean() - d << " sd " << c.sd() << " I " << c.intensity;
      std::cout << "\n";
    }
  for (double i : {0., 30., 60., 75., 80.}) {
    auto r = record(slanted(2000, i), 400);
    std::cout << "inc " << i << " " << r.at(0).mean() - 2000 << " sd " << r.at(0).sd() << "\n";
  }
  auto w = world_of({{"e", 3000, -2000, 3000, 2500, .6}, {"n", 3000, 2500, -2500, 2500, .4}, {"w", -2500, 2500, -2500, -2000, .7}, {"s", -2500, -2000, 3000, -2000, .5}});
  auto e = sim::make_causal_engine(w, 3);
  auto t0 = std::chrono::steady_clock::now();
  record(*e, 1000);
  std::cout << "scans/s " << 1000 / std::chrono::duration<double>(std::chrono::steady_clock::now() - t0).count() << "\n";
}
