// SPDX-License-Identifier: MIT
// Exit status 0 if the correction computes what its equation says.
#include "range_correction_filter/range_correction.hpp"

#include <cstdio>
#include <limits>

using range_correction_filter::Equation;
using range_correction_filter::RangeCorrection;
using range_correction_filter::Term;

static int failures = 0;

static void near(const char* what, double value, double expected) {
  if (std::abs(value - expected) <= 1e-9 * (1 + std::abs(expected))) return;
  std::printf("%s: %.12g, expected %.12g\n", what, value, expected);
  ++failures;
}

static void refused(const char* text) {
  try {
    Equation(text, {"a"}, {1});
  } catch (const std::invalid_argument&) {
    return;
  }
  std::printf("'%s' should have been refused\n", text);
  ++failures;
}

int main() {
  near("precedence", Equation("1 + 2 * 3 - 4 / 2 - 1", {}, {})(0), 4);
  near("signs", Equation("-a * -x", {"a"}, {3})(2), 6);
  near("functions", Equation("a * pow(x, b) + exp(-c * x)", {"a", "b", "c"}, {2, 0.5, 0.25})(4),
       4 + std::exp(-1.0));
  near("numbers", Equation("1.5e1 * x", {}, {})(2), 30);
  for (const char* text : {"", "a +", "(a", "b * x", "exp(a", "a a", "system(a)", "pow(a)"}) refused(text);

  RangeCorrection correction;
  correction.zero_mm = 2;
  correction.use_intensity = correction.use_distance = true;
  correction.intensity = Term(Equation("a / x", {"a"}, {1000}), 100, 2000, true, 2000);  // 0.5 there
  correction.distance = Term(Equation("a + b * x", {"a", "b"}, {1, 0.001}), 200, 9800, false, 0);
  // 2 + (1000/500 - 0.5) = 3.5; 1003.5 - 3.5 = 1000: 1 + 1 = 2
  near("inside", correction.apply(1003.5, 500).range_mm, 998);
  if (correction.apply(1003.5, 500).outside) ++failures;
  near("below the intensities", correction.apply(1011.5, 50).range_mm,
       correction.apply(1011.5, 100).range_mm);
  if (!correction.apply(1011.5, 50).outside || !correction.apply(20000, 500).outside) ++failures;
  if (failures == 0) std::puts("range_correction_test: passed");
  return failures == 0 ? 0 : 1;
}
