// SPDX-License-Identifier: MIT
#include "rig/report/compare_report.hpp"

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>
#include <random>

namespace compare_report_test {
namespace {

constexpr int statistics = 13;

fit::RecordingStatistics drawn(std::mt19937_64& random, std::size_t values, double shift) {
  std::normal_distribution<double> normal;
  fit::RecordingStatistics out;
  out.scans = 100, out.samples = 1000;
  for (int i = 0; i < statistics; ++i) {
    out.statistics.push_back({"statistic " + std::to_string(i), "mm", "what it is", {}});
    for (std::size_t k = 0; k < values; ++k)
      out.statistics.back().values.push_back(1675 + normal(random) + (i == 0 ? shift : 0));
  }
  return out;
}

rig::ComparedDevice device(std::mt19937_64& random, const std::string& file, std::size_t values,
                           double shift) {
  return {"device",
          {file},
          drawn(random, values, shift),
          drawn(random, values, shift),
          drawn(random, values, shift)};
}

int different_in(const nlohmann::json& comparison) {
  int count = 0;
  for (const auto& each : comparison.at("statistics")) count += each.at("verdict") == "differs";
  return count;
}

}  // namespace

TEST_CASE("one device is told from itself at most once in 20 times, and another device is, in either order") {
  std::mt19937_64 random(5);
  int alarms = 0;
  const int trials = 200;
  for (int trial = 0; trial < trials; ++trial) {
    const auto a = device(random, "a.rig", 36, 0), b = device(random, "b.rig", 36, 0);
    alarms += different_in(rig::comparison_json({a, b})) > 0;
  }
  CHECK(alarms <= 16);  // 5 % of 200, and twice the standard deviation of that
  const auto a = device(random, "a.rig", 200, 0), b = device(random, "b.rig", 200, 2);
  const auto one = rig::comparison_json({a, b}), other = rig::comparison_json({b, a});
  CHECK(different_in(one) == 1);
  for (int i = 0; i < statistics; ++i)
    for (const char* key : {"verdict", "distance", "own_distance", "p_value"})
      CHECK(one.at("statistics").at(i).at(key) == other.at("statistics").at(i).at(key));
  const auto few = device(random, "few.rig", 5, 0);
  CHECK(rig::comparison_json({few, few}).at("statistics").at(0).at("verdict") == "agrees");
  const auto far = device(random, "far.rig", 5, 1);
  CHECK(rig::comparison_json({few, far}).at("statistics").at(0).at("verdict") == "undecided");
}

TEST_CASE("a comparison's page names the sessions, writes counts in full, and draws no line of one point") {
  std::mt19937_64 random(6);
  auto a = device(random, "a.rig", 36, 0), b = device(random, "b.rig", 36, 0);
  for (auto* one : {&a, &b}) one->all.profiles = {{"range noise", "mm", {1500}, {8}, {0.1}}};
  const std::string page = rig::comparison_html({a, b});
  CHECK(page.find("a.rig") != std::string::npos);
  CHECK(page.find("b.rig") != std::string::npos);
  CHECK(page.find("1680") != std::string::npos);
  CHECK(page.find("e+03") == std::string::npos);
  CHECK(page.find("Against range") == std::string::npos);
}

}  // namespace compare_report_test
