// SPDX-License-Identifier: MIT
#include "fit/numeric/number_format.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>

namespace number_format_test {

TEST_CASE("a value is rounded to the place of its uncertainty's second digit") {
  CHECK(fit::format_value(-1.6342, 0.1234) == "-1.63");
  CHECK(fit::format_uncertainty(0.1234) == "0.12");
  CHECK(fit::format_value(1234.6, 37.2) == "1235");
  CHECK(fit::format_value(123456, 2345) == "123500");
  CHECK(fit::format_uncertainty(2345) == "2300");
  CHECK(fit::format_value(0.0501, 0.0996) == "0.05");
  CHECK(fit::format_uncertainty(0.0996) == "0.10");
  CHECK(fit::format_value(-0.001, 0.12) == "0.00");
}

TEST_CASE("a small uncertainty is written with a power of ten, and a value that it hides as zero") {
  CHECK(fit::format_uncertainty(0.0001) == "0.00010");
  CHECK(fit::format_uncertainty(0.000099) == "9.9e-5");
  CHECK(fit::format_uncertainty(5.6e-7) == "5.6e-7");
  CHECK(fit::format_uncertainty(9.96e-11) == "1.0e-10");
  CHECK(fit::format_measurement(0, 5.6e-7, "") == "0 ± 5.6e-7");
  CHECK(fit::format_measurement(-4e-9, 5.6e-7, "%") == "0 ± 5.6e-7 %");
  CHECK(fit::format_value(7e-9, 5.6e-7) == "1e-8");
  CHECK(fit::format_value(3e-7, 5.6e-7) == "3.0e-7");
  CHECK(fit::format_value(-1.23456e-5, 5.6e-7) == "-1.235e-5");
  CHECK(fit::format_value(0.25, 5.6e-7) == "0.25000000");  // All of its digits are known.
}

TEST_CASE("a measurement is written with its uncertainty and unit, as far as there are any") {
  CHECK(fit::format_measurement(-1.6342, 0.1234, "mm") == "-1.63 ± 0.12 mm");
  CHECK(fit::format_measurement(320, 0, "") == "320");
  CHECK(fit::format_measurement(3.25, std::nan(""), "mm") == "3.25 mm");
}

TEST_CASE("what is not a number is not printed as one") {
  CHECK(fit::format_value(std::nan(""), 1) == "not determined");
  CHECK(fit::format_uncertainty(std::numeric_limits<double>::infinity()) == "not determined");
  CHECK(fit::format_value(3.25, 0) == "3.25");
}

TEST_CASE("without an uncertainty a value has four significant digits, a count all of them") {
  CHECK(fit::format_value(3.141592, 0) == "3.142");
  CHECK(fit::format_value(12345.678, 0) == "12346");
  CHECK(fit::format_value(1081, 0) == "1081");
  CHECK(fit::format_value(100000, 0) == "100000");
  CHECK(fit::format_value(0.000123456, 0) == "0.0001235");
  CHECK(fit::format_value(-0.0, 0) == "0");
}

TEST_CASE("all digits of a value are the fewest that read back exactly") {
  CHECK(fit::format_exactly(0.1) == "0.1");
  CHECK(fit::format_exactly(0.1 + 0.2) == "0.30000000000000004");
  CHECK(fit::format_exactly(-2376) == "-2376");
  CHECK(std::stod(fit::format_exactly(1.0 / 3)) == 1.0 / 3);
}

TEST_CASE("the coverage factor agrees with GUM table G.2 at 95.45 percent") {
  CHECK(fit::coverage_factor(4) == Approx(2.87).margin(0.005));
  CHECK(fit::coverage_factor(9) == Approx(2.32).margin(0.005));
  CHECK(fit::coverage_factor(20) == Approx(2.13).margin(0.005));
  CHECK(fit::coverage_factor(50) == Approx(2.05).margin(0.005));
  CHECK(fit::coverage_factor(std::numeric_limits<double>::infinity()) == 2);
}

}  // namespace number_format_test
