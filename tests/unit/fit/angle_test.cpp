// SPDX-License-Identifier: MIT
#include "fit/numeric/angle.hpp"

#include <catch2/catch.hpp>

namespace angle_test {

TEST_CASE("an angle wraps into the half-open circle") {
  CHECK(fit::wrap_angle(fit::pi) == Approx(fit::pi));
  CHECK(fit::wrap_angle(-fit::pi) == Approx(fit::pi));
  CHECK(fit::wrap_angle(3 * fit::pi / 2) == Approx(-fit::pi / 2));
  CHECK(fit::wrap_angle(0.25) == 0.25);
}

}  // namespace angle_test
