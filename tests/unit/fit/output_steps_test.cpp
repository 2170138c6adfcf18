// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/output_steps.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "fit/explain/reduction/reduce.hpp"

namespace output_steps_test {

using fit::explain::OutputSteps;

TEST_CASE("means and variances of ranges that come in steps are those of samples drawn and rounded") {
  const auto [step, first, sigma] =
      GENERATE(table<double, double, double>({{12.69, 3.1, 4}, {5.88, 0, 0.8}, {2.5, 1, 3}, {17, 0, 11}}));
  const OutputSteps steps{step, first, sigma};
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0, sigma);
  for (const double range : {1000.0, 1003.7, 2222.2, 4321.9}) {
    constexpr int samples = 400'000;
    double sum = 0, squares = 0;
    for (int i = 0; i < samples; ++i) {
      const double off =
          std::round(first + step * std::round((range + noise(random) - first) / step)) - range;
      sum += off;
      squares += off * off;
    }
    const double bias = sum / samples, variance = squares / samples - bias * bias,
                 four_u = 4 * std::sqrt(variance / samples);
    INFO(step << " mm, noise " << sigma << " mm, at " << range << " mm");
    CHECK(steps.bias_mm(range) == Approx(bias).margin(four_u));
    CHECK(steps.variance_mm2(range) + sigma * sigma == Approx(variance).epsilon(0.02).margin(0.01));
  }
}

TEST_CASE("the noise before rounding is found from how samples scatter after it, wherever they lie") {
  constexpr double step_mm = 12.69;
  for (const double sigma : {4.0, 9.0, 40.0})
    for (const double apart_mm : {1.234, step_mm + 0.1}) {  // all over the steps, and always in the same half
      const OutputSteps steps{step_mm, 3.1, sigma};
      std::vector<OutputSteps::Scatter> readings;
      for (int i = 0; i < 60; ++i) {
        const double range_mm = 703 + apart_mm * i;
        readings.push_back(
            {range_mm + steps.bias_mm(range_mm), steps.variance_mm2(range_mm) + sigma * sigma, 10.0 + i % 3});
      }
      INFO(sigma << " mm, every " << apart_mm << " mm");
      CHECK(OutputSteps{step_mm, 3.1}.noise_of(readings) == Approx(sigma).epsilon(0.01));
    }
}

TEST_CASE("noise that fills whole millimetres leaves a twelfth, and no bias") {
  const OutputSteps steps;
  CHECK(steps.bias_mm(1234.5) == 0);
  CHECK(steps.variance_mm2(1234.5) == fit::explain::rounding_mm2);
}

}  // namespace output_steps_test
