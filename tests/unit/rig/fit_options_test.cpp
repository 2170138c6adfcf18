// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "rig/errors.hpp"
#include "rig/fitting/fitting.hpp"
#include "tests/support/test_folder.hpp"

namespace fit_options_test {
namespace {

using nlohmann::json;
using Type = rig::FitOption::Type;

std::vector<rig::FitOption> examples() {
  return {{.name = "width_mm", .unit = "mm", .min = 1, .max = 500, .otherwise = 20.0, .about = "width"},
          {.name = "rounds", .type = Type::integer, .min = 0, .about = "rounds"},
          {.name = "refine", .type = Type::flag, .about = "refine"},
          {.name = "target", .type = Type::text, .about = "target"},
          {.name = "side", .type = Type::choice, .choices = {"left", "right"}, .about = "side"}};
}

rig::FitOptions options(const json& given) { return {"example", examples(), given}; }

}  // namespace

TEST_CASE("an option is what was given, else its default, else absent") {
  const auto given = options({{"width_mm", 35.5}, {"rounds", 3}, {"refine", true}, {"target", 12}});
  CHECK(given.number("width_mm") == 35.5);
  CHECK(given.integer("rounds") == 3);
  CHECK(given.flag("refine"));
  CHECK(given.text("target") == "12");
  CHECK_FALSE(given.has("side"));
  CHECK(given.text("side").empty());
  const auto none = options(nullptr);
  CHECK(none.number("width_mm") == 20);
  CHECK_FALSE(none.has("width_mm"));
  CHECK_FALSE(none.maybe_number("rounds"));
  CHECK_FALSE(none.maybe_flag("refine"));
}

TEST_CASE("an option of another name, type or range is refused with what was expected and what to do") {
  const auto refused = [](const json& given, const char* words) {
    INFO(given.dump());
    CHECK_THROWS_WITH(options(given), Catch::Contains(words));
    CHECK_THROWS_AS(options(given), rig::UsageError);
  };
  refused({{"widht_mm", 3}}, "did you mean 'width_mm'?");
  refused({{"width_mm", "wide"}}, "must be a number from 1 to 500 mm, not \"wide\"");
  refused({{"width_mm", 0.5}}, "must be a number from 1 to 500 mm, not 0.5");
  refused({{"width_mm", json::array({1})}}, "rig fit example --help");
  refused({{"rounds", 2.5}}, "must be a whole number of 0 or more, not 2.5");
  refused({{"refine", 1}}, "must be true or false");
  refused({{"target", true}}, "must be a text");
  refused({{"side", "lfet"}}, "must be one of left, right, not \"lfet\"; did you mean 'left'?");
  refused(json::array(), "must be a map");
}

TEST_CASE("what only a run will know is not judged before it, its name is") {
  CHECK_NOTHROW(rig::check_fit("wall", {{"tolerance_mm", nullptr}}));
  CHECK_THROWS_AS(rig::check_fit("wall", {{"tolerance", nullptr}}), rig::UsageError);
  CHECK_THROWS_AS(rig::check_fit("wall", {{"tolerance_mm", "20"}}), rig::UsageError);
}

TEST_CASE("a value that no result of a calibration has is refused with what was meant") {
  CHECK_NOTHROW(rig::check_value("centre", "centre_x_mm"));
  CHECK_NOTHROW(rig::check_value("odometry", "wheelbase_mm"));
  CHECK_NOTHROW(rig::check_value("range", "error_at_500_mm"));
  const auto refused = [](const char* kind, const char* value, const char* words) {
    INFO(kind << "." << value);
    CHECK_THROWS_WITH(rig::check_value(kind, value), Catch::Contains(words));
    CHECK_THROWS_AS(rig::check_value(kind, value), rig::UsageError);
  };
  refused("noize", "noise_median_mm", "there is no calibration 'noize'; did you mean 'noise'?");
  refused("noise", "noise_meadian_mm", "gives no value 'noise_meadian_mm'; did you mean 'noise_median_mm'?");
  refused("centre", "x_mm", "There are: centre_x_mm, centre_y_mm");
  refused("range", "error_at_half_mm", "error_at_*_mm");
  refused("range", "error_at__mm", "error_at_*_mm");
}

TEST_CASE("every value of every calibration stands in the docs") {
  std::stringstream docs;
  docs << std::ifstream(std::string(RIG_SOURCE_DIR) + "/docs/operate/calibrations.md").rdbuf();
  for (const auto& fitting : rig::all_fittings()) {
    CHECK_FALSE(fitting->values().empty());
    for (std::string name : fitting->values()) {
      INFO(fitting->kind() << " " << name);
      if (const auto star = name.find('*'); star != name.npos) name.replace(star, 1, "500");
      CHECK_THAT(docs.str(), Catch::Contains("`" + name + "`"));
    }
  }
}

TEST_CASE(
    "every option of every calibration has a meaning, a unit where its name has one, and a line in the "
    "docs") {
  std::stringstream docs;
  docs << std::ifstream(std::string(RIG_SOURCE_DIR) + "/docs/operate/calibrations.md").rdbuf();
  for (const auto& fitting : rig::all_fittings())
    for (const rig::FitOption& option : fitting->options()) {
      INFO(fitting->kind() << " " << option.name);
      CHECK_FALSE(option.about.empty());
      CHECK((option.type == Type::choice) != option.choices.empty());
      for (const char* unit : {"mm", "deg", "ms"})
        if (option.name.ends_with(std::string("_") + unit)) CHECK(option.unit == unit);
      CHECK_THAT(docs.str(), Catch::Contains("| `" + option.name + "` | " + rig::expectation(option) + " |"));
      // A default must be what the option itself takes.
      if (option.otherwise)
        CHECK_NOTHROW(rig::check_fit(
            fitting->kind(),
            {{option.name, std::visit([](const auto& value) { return json(value); }, *option.otherwise)}}));
    }
}

TEST_CASE("a damaged file that a validation names is refused as a wrong option is, before the run") {
  const TestFolder place;
  std::ofstream(place / "noise.rig") << std::string("SQLite format 3\0", 16) << std::string(5000, '\x07');
  std::ofstream(place / "text.rig") << "no session";
  std::ofstream(place / "broken.json") << "{";
  for (const char* option : {"centre", "correction"})
    for (const char* name : {"noise.rig", "text.rig", "broken.json", "none.rig"}) {
      INFO(option << " " << name);
      CHECK_THROWS_AS(rig::check_fit("validation", {{option, place / name}}), rig::UsageError);
    }
}

}  // namespace fit_options_test
