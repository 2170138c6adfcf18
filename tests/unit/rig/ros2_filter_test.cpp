// SPDX-License-Identifier: MIT
// docs/examples/range_correction_filter, compiled against as much of ROS 2 as it uses.
#define RANGE_CORRECTION_FILTER_WITHOUT_MAIN
#include <yaml-cpp/yaml.h>

#include <catch2/catch.hpp>
#include <cstdlib>
#include <fstream>

#include "docs/examples/range_correction_filter/src/range_correction_filter.cpp"
#include "fit/range/correction.hpp"
#include "fit/range/family.hpp"
#include "rig/export/exporter.hpp"
#include "tests/support/test_folder.hpp"

namespace ros2_filter_test {
namespace {

using range_correction_filter::RangeCorrectionFilter;
using Scan = sensor_msgs::msg::LaserScan;

/// A parameter file as ROS 2 reads it: names joined by dots.
void read_parameters(const YAML::Node& node, const std::string& name,
                     std::map<std::string, rclcpp::Value>& into) {
  if (node.IsMap()) {
    for (const auto& member : node)
      read_parameters(member.second, (name.empty() ? "" : name + ".") + member.first.as<std::string>(), into);
  } else if (node.IsSequence()) {
    const bool text = node.size() > 0 && node[0].Tag() == "!";
    into[name] = text ? rclcpp::Value(node.as<std::vector<std::string>>())
                      : rclcpp::Value(node.as<std::vector<double>>());
  } else if (node.Tag() == "!") {  // in quotes
    into[name] = node.as<std::string>();
  } else if (node.Scalar() == "true" || node.Scalar() == "false") {
    into[name] = node.as<bool>();
  } else {
    into[name] = node.as<double>();
  }
}

rclcpp::NodeOptions options_for(const fit::Correction& correction) {
  const TestFolder folder;
  std::ofstream(folder / "correction.json") << fit::to_json_text(correction);
  rig::run_export("ros2-parameters", {folder / "correction.json"},
                  rig::check_output({folder / "parameters.yaml"}));
  rclcpp::NodeOptions options;
  read_parameters(YAML::LoadFile(folder / "parameters.yaml")["/**"]["ros__parameters"], "",
                  options.overrides);
  return options;
}

fit::Correction correction_with(std::optional<fit::CorrectionTerm> intensity,
                                std::optional<fit::CorrectionTerm> range) {
  fit::Correction correction;
  correction.zero_mm = {2.25, 0.1};
  correction.intensity = std::move(intensity), correction.range = std::move(range);
  correction.factor =
      Eigen::MatrixXd::Constant(static_cast<Eigen::Index>(correction.parameter_names().size()), 1, 1e-3);
  return correction;
}

Scan pass(RangeCorrectionFilter& node, const Scan& scan) {
  const auto in = std::static_pointer_cast<rclcpp::Subscription<Scan>>(node.subscriptions.at("scan"));
  const auto out = std::static_pointer_cast<rclcpp::Publisher<Scan>>(node.publishers.at("scan_corrected"));
  in->call(std::make_shared<const Scan>(scan));
  return out->published.back();
}

}  // namespace

TEST_CASE("the ROS 2 filter of the examples corrects as rig does, by the equation of every family") {
  using Argument = fit::CorrectionTerm::Argument;
  int families = 0;
  for (const auto& family : fit::all_families()) {
    if (family.honest_reference || family.equation.empty()) continue;
    INFO(family.id);
    std::vector<double> coefficients;
    for (std::size_t i = 0; i < family.coefficients.size(); ++i)
      coefficients.push_back(0.3 + 0.01 * static_cast<double>(i));
    // x from 0.2 to 4: where every family is tame with these coefficients.
    const auto correction = correction_with(
        {}, fit::CorrectionTerm{Argument::range, family.id, coefficients, 0.2, 4, 1.0, {}, {}});
    RangeCorrectionFilter node(options_for(correction));
    Scan scan;
    for (const float range_mm : {2.5F, 3.0F, 4.5F, 6.0F, 50.0F}) scan.ranges.push_back(range_mm / 1000);
    const Scan out = pass(node, scan);
    for (std::size_t i = 0; i < scan.ranges.size(); ++i)
      CHECK(1000 * static_cast<double>(out.ranges[i]) ==
            Approx(correction.apply(1000 * static_cast<double>(scan.ranges[i]), 0).range_mm).margin(1e-4));
    ++families;
  }
  CHECK(families >= 7);
}

TEST_CASE(
    "the ROS 2 filter uses intensities, leaves what saw nothing, and says when intensities are missing") {
  using Argument = fit::CorrectionTerm::Argument;
  const auto correction = correction_with(
      fit::CorrectionTerm{Argument::intensity, "line", {20, -0.008}, 100, 2400, 2400.0, {}, {}},
      fit::CorrectionTerm{Argument::range, "line", {1, 0.002}, 200, 9800, {}, {}, {}});
  rclcpp::NodeOptions options = options_for(correction);
  RangeCorrectionFilter node(options);
  Scan scan;
  scan.ranges = {1.5F, INFINITY, NAN, 0.0F, 3.0F, 20.0F};
  scan.intensities = {500, 0, 0, 0, 2000, 2000};
  const Scan out = pass(node, scan);
  for (const std::size_t i : {0U, 4U, 5U})
    CHECK(static_cast<double>(out.ranges[i]) == Approx(correction
                                                           .apply(1000 * static_cast<double>(scan.ranges[i]),
                                                                  static_cast<double>(scan.intensities[i]))
                                                           .range_mm /
                                                       1000));
  CHECK(std::isinf(out.ranges[1]));
  CHECK(std::isnan(out.ranges[2]));
  CHECK(out.ranges[3] == 0);
  CHECK(node.warnings == 0);
  scan.intensities.clear();
  CHECK(pass(node, scan).ranges[0] == 1.5F);
  CHECK(node.warnings == 1);
  options.overrides["drop_outside"] = true;
  RangeCorrectionFilter dropping(options);
  scan.intensities = {500, 0, 0, 0, 2000, 2000};
  CHECK(std::isnan(pass(dropping, scan).ranges[5]));
  CHECK_THROWS_AS(RangeCorrectionFilter(rclcpp::NodeOptions{}), std::runtime_error);
}

TEST_CASE("the example's own test passes with a C++17 compiler and nothing else") {
  const TestFolder folder;
  const std::string package = RIG_SOURCE_DIR "/docs/examples/range_correction_filter";
  const std::string program = folder / "test";
  REQUIRE(std::system(("c++ -std=c++17 -Wall -Wextra -Werror -I " + package + "/include " + package +
                       "/test/range_correction_test.cpp -o " + program)
                          .c_str()) == 0);
  CHECK(std::system((program + " > " + (folder / "said")).c_str()) == 0);
}

}  // namespace ros2_filter_test
