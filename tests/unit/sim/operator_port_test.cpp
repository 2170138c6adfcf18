// SPDX-License-Identifier: MIT
#include "sim/operator_port.hpp"

#include <boost/asio/io_context.hpp>
#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace operator_port_test {

using nlohmann::json;

TEST_CASE("the operator port places targets, keeps what is not mentioned and refuses what there is not") {
  boost::asio::io_context io;
  std::vector<sim::SceneState> seen;
  sim::OperatorPort::Options options;
  options.targets = {"board", "wall"};
  sim::OperatorPort::Bench bench;
  bench.place = [&](const sim::SceneState& scene) { seen.push_back(scene); };
  std::vector<double> switched_on;
  bench.switch_on = [&](double since_s) { switched_on.push_back(since_s); };
  bench.fault = [](const std::string& fault) {
    if (fault != "stage stall") throw std::invalid_argument("no such fault");
  };
  bench.state = [] { return json{{"time_s", 1.5}}; };
  sim::OperatorPort port(io.get_executor(), options, bench);
  const auto say = [&](const std::string& line) { return json::parse(port.answer(line)); };

  CHECK(say(R"({"place": {"target": "board", "shift_mm": 100, "reflectance": 0.2}})") == json{{"ok", true}});
  CHECK(say(R"({"place": {"target": "board", "temperature_c": 31}})")["ok"] == true);
  CHECK(say(R"({"place": {"target": "wall", "shift_mm": -5}})")["ok"] == true);
  REQUIRE(seen.size() == 3);
  CHECK(seen[1].target_shift_mm == 100);
  CHECK(seen[1].reflectance == 0.2);
  CHECK(seen[2].temperature_c == 31);
  CHECK(seen[2].reflectance < 0);
  CHECK(seen[1].held_s > 0);  // Whoever is asked for a temperature holds it.
  CHECK(seen[2].held_s == 0);
  CHECK(say(R"({"place": {"temperature_c": 25, "since_power_on_s": 0}})")["ok"] == true);
  CHECK(switched_on == std::vector<double>{0});
  CHECK(seen.back().temperature_c == 25);
  CHECK(say(R"({"get": "state"})")["time_s"] == 1.5);
  CHECK(say(R"({"fault": "stage stall"})")["ok"] == true);
  for (const char* wrong :
       {"", "nonsense", "[]", "{}", R"({"place": {"target": "door"}})", R"({"place": {"shift_mm": 5}})",
        R"({"place": {"target": "board", "shift_mm": "far"}})", R"({"place": {"since_power_on_s": "long"}})",
        R"({"place": {"target": 5}})", R"({"place": {"colour": 1}})", R"({"fault": "x"})",
        R"({"get": "rich"})"})
    CHECK(say(wrong)["ok"] == false);
  CHECK(seen.size() == 4);
  CHECK(switched_on.size() == 1);
}

TEST_CASE("a port that another program holds is named, with a way out") {
  boost::asio::io_context io;
  sim::OperatorPort::Options options;
  options.port = 0;
  const sim::OperatorPort first(io.get_executor(), options, {});
  options.port = first.port();
  CHECK_THROWS_WITH(sim::OperatorPort(io.get_executor(), options, {}),
                    Catch::Contains("operator's port 127.0.0.1:" + std::to_string(first.port())) &&
                        Catch::Contains("another simulator") && !Catch::Contains("boost"));
}

}  // namespace operator_port_test
