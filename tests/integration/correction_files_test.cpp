// SPDX-License-Identifier: MIT
// Corrections as files: for the rig itself, for compilers, tables and parameters; and their use on a session.
#include <unistd.h>
#include <yaml-cpp/yaml.h>

#include <catch2/catch.hpp>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <sstream>

#include "fit/range/correction.hpp"
#include "fit/range/family.hpp"
#include "rig/errors.hpp"
#include "rig/export/exporter.hpp"
#include "rig/fitting/apply_session.hpp"
#include "rig/fitting/correction_source.hpp"
#include "tests/support/range_ladder.hpp"
#include "tests/support/test_folder.hpp"

namespace correction_files_test {

using range_ladder::Ladder;

namespace {

namespace fs = std::filesystem;

/// A correction with every kind of term, for exports.
fit::Correction example(const std::string& intensity, const std::string& range) {
  static const std::map<std::string, std::vector<double>> coefficients = {
      {"constant", {4.5}},
      {"line", {4.5, -0.002}},
      {"polynomial-3", {2e-9, -8e-6, 0.004, 12}},
      {"exponential-2", {-326000, -0.001598, 325900, -0.001597}},
      {"confluent-exponential", {30, -0.02, 0.0016}},
      {"fourier-2", {919.7, -966.6, 777, 52.28, -326.3, -1.341e-4}},
      {"power-2", {5000, -0.8, -9}},
      {"rational-33", {12, -20000, 3e6, 7e9, -1000, 900000, 6e8}}};
  fit::Correction c;
  c.zero_mm = {1.0 / 3, 0.05};
  c.intensity = fit::CorrectionTerm{fit::CorrectionTerm::Argument::intensity,
                                    intensity,
                                    coefficients.at(intensity),
                                    200,
                                    2400,
                                    2399.5,
                                    {},
                                    {}};
  c.range = fit::CorrectionTerm{
      fit::CorrectionTerm::Argument::range, range, coefficients.at(range), 210.5, 9700, {}, {}, {}};
  const auto n = static_cast<Eigen::Index>(c.parameter_names().size());
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  c.factor = Eigen::MatrixXd::NullaryExpr(n, 3, [&] { return 1e-6 * normal(random); });
  c.common_u_mm = 0.25;
  c.lidar_model = "UST-10LX", c.lidar_serial = "H*/1";
  return c;
}

const std::vector<std::pair<std::string, std::string>> pairs = {{"confluent-exponential", "fourier-2"},
                                                                {"exponential-2", "polynomial-3"},
                                                                {"rational-33", "power-2"},
                                                                {"line", "rational-33"}};

/// Places inside and outside the calibrated region.
std::vector<std::pair<double, double>> probes() {
  std::vector<std::pair<double, double>> out;
  for (const double range : {100.0, 250.0, 777.7, 3000.0, 9650.0, 12000.0})
    for (const double counts : {50.0, 200.0, 811.0, 2400.0, 4000.0}) out.emplace_back(range, counts);
  return out;
}

std::string export_as(const TestFolder& place, const fit::Correction& correction, const std::string& format,
                      const std::string& name) {
  const std::string json = place / "correction.json", out = place / name;
  std::ofstream(json) << fit::to_json_text(correction);
  rig::run_export(format, {json, nullptr}, rig::check_output({out}));
  return out;
}

bool compiles(const std::string& command) {
  INFO(command);
  const int status = std::system(command.c_str());
  CHECK(status == 0);
  return status == 0;
}

}  // namespace

TEST_CASE("corrections survive being written, and damaged ones are refused with the place") {
  for (const auto& [intensity, range] : pairs) {
    const fit::Correction c = example(intensity, range);
    const std::string text = fit::to_json_text(c);
    const fit::Correction again = fit::parse_correction(text);
    CHECK(fit::to_json_text(again) == text);
    for (const auto& [r, i] : probes()) {
      CHECK(again.apply(r, i).range_mm == c.apply(r, i).range_mm);
      CHECK(again.u(r, i) == c.u(r, i));
    }
  }
  const std::string good = fit::to_json_text(example("line", "line"));
  const auto broken = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    text.replace(text.find(from), from.size(), to);
    return text;
  };
  CHECK_THROWS_WITH(fit::parse_correction(broken("correction/1", "correction/9")),
                    Catch::Contains("/schema: must be \"correction/1\""));
  CHECK_THROWS_WITH(fit::parse_correction(broken("\"line\"", "\"lime\"")),
                    Catch::Contains("there is no equation 'lime'"));
  CHECK_THROWS_WITH(fit::parse_correction(broken("\"common_u_mm\": ", "\"common_u_mm\": -")),
                    Catch::Contains("/common_u_mm: is an uncertainty, which is not negative"));
  CHECK_THROWS_WITH(fit::parse_correction("{\n  nonsense"), Catch::Contains("correction:2:"));
  CHECK_THROWS_WITH(fit::parse_correction(broken("\"terms\"", "\"term\"")),
                    Catch::Contains("/terms: must be a list"));
}

TEST_CASE("a C header compiles alone and corrects as the calibration does") {
  if (std::system("command -v cc >/dev/null 2>&1") != 0) {
    WARN("skipped: there is no C compiler here");
    return;
  }
  const TestFolder place;
  for (const auto& [intensity, range] : pairs) {
    const fit::Correction c = example(intensity, range);
    export_as(place, c, "c-header", "correction.h");
    std::ofstream(place / "try.c") << R"(#include "correction.h"
#include <stdio.h>
int main(void) {
  double r, i, map[2], zero[2] = {0, 0};
  while (scanf("%lf %lf", &r, &i) == 2) {
    double out; int state = lidar_range_correct(r, i, &out);
    lidar_range_to_map(out, 0.3, zero, lidar_range_centre_mm, 1, 2, 0.5, map);
    printf("%d %.17g %.17g\n", state, out, map[0]);
  }
  return 0;
})";
    std::ofstream in(place / "in");
    for (const auto& [r, i] : probes()) in << r << " " << i << "\n";
    in.close();
    REQUIRE(compiles("cc -std=c99 -pedantic -Wall -Wextra -Werror -Wno-unused-function -o " + place / "try" +
                     " " + place / "try.c" + " -lm && " + place / "try" + " <" + place / "in" + " >" +
                     place / "out"));
    std::ifstream out(place / "out");
    for (const auto& [r, i] : probes()) {
      int state = -1;
      double corrected = 0, map_x = 0;
      REQUIRE(out >> state >> corrected >> map_x);
      const auto expected = c.apply(r, i);
      CHECK(corrected == Approx(expected.range_mm).epsilon(1e-12).margin(1e-9));
      CHECK(state == (expected.range_outside ? 1 : 0) + (expected.intensity_outside ? 2 : 0));
      CHECK(map_x == Approx(expected.range_mm * std::cos(0.8) + 1).margin(1e-6));
    }
  }
}

TEST_CASE("a C++ header compiles alone, corrects as the calibration does, and knows its uncertainty") {
  if (std::system("command -v c++ >/dev/null 2>&1") != 0) {
    WARN("skipped: there is no C++ compiler here");
    return;
  }
  const TestFolder place;
  for (const auto& [intensity, range] : pairs) {
    const fit::Correction c = example(intensity, range);
    export_as(place, c, "cpp-header", "correction.hpp");
    std::ofstream(place / "try.cpp") << R"(#include "correction.hpp"
#include <cstdio>
int main() {
  double r, i;
  while (std::scanf("%lf %lf", &r, &i) == 2) {
    const lidar_range::Corrected c = lidar_range::correct(r, i);
    std::printf("%d %.17g %.17g\n", c.inside(), c.range_mm, c.u_mm);
  }
})";
    std::ofstream in(place / "in");
    for (const auto& [r, i] : probes()) in << r << " " << i << "\n";
    in.close();
    REQUIRE(compiles("c++ -std=c++11 -pedantic -Wall -Wextra -Werror -Wno-unused -o " + place / "try" + " " +
                     place / "try.cpp" + " && " + place / "try" + " <" + place / "in" + " >" +
                     place / "out"));
    std::ifstream out(place / "out");
    for (const auto& [r, i] : probes()) {
      int inside = -1;
      double corrected = 0, u = 0;
      REQUIRE(out >> inside >> corrected >> u);
      const auto expected = c.apply(r, i);
      CHECK(corrected == Approx(expected.range_mm).epsilon(1e-12).margin(1e-9));
      CHECK(u == Approx(c.u(r, i)).epsilon(1e-6));
      CHECK((inside == 1) == expected.inside());
    }
  }
}

TEST_CASE("a look-up table interpolates to the correction, and ROS 2 parameters evaluate to it") {
  const TestFolder place;
  fit::Correction c = example("confluent-exponential", "fourier-2");
  std::ifstream table(export_as(place, c, "csv-table", "table.csv"));
  std::string line;
  std::getline(table, line);
  CHECK(line == "range_mm,intensity,corrected_mm,u_mm");
  long rows = 0;
  std::set<double> ranges, intensities;  // A grid: every value of the one beside every value of the other.
  while (std::getline(table, line)) {
    std::istringstream cells(line);
    double range = 0, counts = 0, corrected = 0, u = 0;
    char comma = 0;
    REQUIRE(cells >> range >> comma >> counts >> comma >> corrected >> comma >> u);
    ranges.insert(range);
    intensities.insert(counts);
    if (++rows % 97 != 0) continue;
    CHECK(c.apply(range, counts).range_mm == Approx(corrected).margin(1e-9));
    CHECK(c.u(range, counts) == Approx(u).epsilon(1e-6));
  }
  CHECK(rows == 201 * 101);
  CHECK(ranges.size() == 201);
  CHECK(intensities.size() == 101);

  const YAML::Node node = YAML::LoadFile(export_as(
      place, c, "ros2-parameters", "correction.yaml"))["/**"]["ros__parameters"]["range_correction"];
  CHECK(node["lidar_serial"].as<std::string>() == "H*/1");
  const auto term = [&](const std::string& name, double x) {
    const auto coefficients = node[name]["coefficients"].as<std::vector<double>>();
    const fit::Family& family = *fit::find_family(node[name]["family"].as<std::string>());
    const double zero = node[name]["has_zero"].as<bool>()
                            ? family.value(coefficients, node[name]["zero_at"].as<double>())
                            : 0;
    return family.value(coefficients, x) - zero;
  };
  for (const double range : {400.0, 5000.0}) {
    double error = node["zero_mm"].as<double>() + term("intensity", 811);
    error += term("distance", range - error);
    CHECK(range - error == c.apply(range, 811).range_mm);
  }
  // A session without a range calibration has nothing to export.
  const Ladder empty(place / "empty.rig", 1, 3);
  CHECK_THROWS_WITH(rig::run_export("c-header", {empty.path(), &const_cast<Ladder&>(empty).store()},
                                    rig::check_output({place / "x.h"})),
                    Catch::Contains("holds no range correction"));
}

TEST_CASE("a correction for another lidar is not applied by mistake") {
  const TestFolder place;
  Ladder session(place / "one.rig", 1, 3);
  session.capture(500, 0.8, 20);
  rig::ApplyRequest request;
  request.correction = example("line", "line");
  request.correction.lidar_serial = "H0000000";
  request.input = session.path(), request.output = rig::check_output({place / "out.rig"});
  CHECK_THROWS_WITH(rig::apply_to_session(request), Catch::Contains("H0000000"));
  CHECK_FALSE(fs::exists(request.output.path()));
  request.any_lidar = true;
  request.drop_outside = true;
  CHECK(rig::apply_to_session(request).samples == 20);
  fs::remove(request.output.path());
  request.any_lidar = false;
  request.correction.lidar_serial.clear();
  const auto report = rig::apply_to_session(request);
  REQUIRE(report.warnings.size() == 1);
  CHECK_THAT(report.warnings.front(), Catch::Contains("the correction does not say which lidar it is of"));
  fs::remove(request.output.path());
  request.correction.validity.beam_deg = fit::Validity::Interval{170, 180};
  CHECK_THAT(
      rig::apply_to_session(request).warnings.back(),
      Catch::Contains("100.0 % of the beams point elsewhere than those with which the correction was"));
  fs::remove(request.output.path());
  request.correction.lidar_model = "UTM-30LX";
  CHECK_THROWS_WITH(rig::apply_to_session(request), Catch::Contains("UTM-30LX"));
}

}  // namespace correction_files_test
