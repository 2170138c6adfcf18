// SPDX-License-Identifier: MIT
#include "rig/number_format.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>

TEST_CASE("a value is rounded to the place of its uncertainty's second digit") {
  CHECK(rig::format_value(-1.6342, 0.1234) == "-1.63");
  CHECK(rig::format_uncertainty(0.1234) == "0.12");
  CHECK(rig::format_value(1234.6, 37.2) == "1235");
  CHECK(rig::format_value(123456, 2345) == "123500");
  CHECK(rig::format_uncertainty(2345) == "2300");
  CHECK(rig::format_value(0.0501, 0.0996) == "0.05");
  CHECK(rig::format_uncertainty(0.0996) == "0.10");
  CHECK(rig::format_value(-0.001, 0.12) == "0.00");
}

TEST_CASE("a measurement is written with its uncertainty and unit, as far as there are any") {
  CHECK(rig::format_measurement(-1.6342, 0.1234, "mm") == "-1.63 ± 0.12 mm");
  CHECK(rig::format_measurement(320, 0, "") == "320");
  CHECK(rig::format_measurement(3.25, std::nan(""), "mm") == "3.25 mm");
}

TEST_CASE("what is not a number is not printed as one") {
  CHECK(rig::format_value(std::nan(""), 1) == "not determined");
  CHECK(rig::format_uncertainty(std::numeric_limits<double>::infinity()) == "not determined");
  CHECK(rig::format_value(3.25, 0) == "3.25");
}

TEST_CASE("without an uncertainty a value has four significant digits, a count all of them") {
  CHECK(rig::format_value(3.141592, 0) == "3.142");
  CHECK(rig::format_value(12345.678, 0) == "12346");
  CHECK(rig::format_value(1081, 0) == "1081");
  CHECK(rig::format_value(100000, 0) == "100000");
  CHECK(rig::format_value(0.000123456, 0) == "0.0001235");
  CHECK(rig::format_value(-0.0, 0) == "0");
}

TEST_CASE("the coverage factor agrees with GUM table G.2 at 95.45 percent") {
  CHECK(rig::coverage_factor(4) == Approx(2.87).margin(0.005));
  CHECK(rig::coverage_factor(9) == Approx(2.32).margin(0.005));
  CHECK(rig::coverage_factor(20) == Approx(2.13).margin(0.005));
  CHECK(rig::coverage_factor(50) == Approx(2.05).margin(0.005));
  CHECK(rig::coverage_factor(std::numeric_limits<double>::infinity()) == 2);
}
