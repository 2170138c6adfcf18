// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <valijson/adapters/nlohmann_json_adapter.hpp>
#include <valijson/schema.hpp>
#include <valijson/schema_parser.hpp>
#include <valijson/validation_results.hpp>
#include <valijson/validator.hpp>

#include "fit/bench/bench.hpp"
#include "fit/range/correction.hpp"

namespace schema_test {
namespace {

using nlohmann::json;
const std::filesystem::path source_dir = RIG_SOURCE_DIR;

std::string text_of(const std::filesystem::path& path) {
  std::ifstream file(path);
  REQUIRE(file.good());
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

/// What the schema says against the document; empty when it is content.
std::string complaints(const std::string& schema_file, const json& document) {
  const json text = json::parse(text_of(source_dir / "procedures" / schema_file));
  valijson::Schema schema;
  valijson::SchemaParser().populateSchema(valijson::adapters::NlohmannJsonAdapter(text), schema);
  valijson::ValidationResults results;
  valijson::Validator validator;
  if (validator.validate(schema, valijson::adapters::NlohmannJsonAdapter(document), &results)) return "";
  std::string out;
  for (const auto& error : results) {
    for (const std::string& part : error.context) out += part;
    out += ": " + error.description + "\n";
  }
  return out.empty() ? "refused" : out;
}

}  // namespace

TEST_CASE("Every bench file of the project satisfies the published schema and the reader") {
  int seen = 0;
  for (const char* folder : {"procedures", "sim", "docs"}) {
    if (!std::filesystem::exists(source_dir / folder)) continue;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(source_dir / folder)) {
      if (!entry.path().string().ends_with(".bench.json")) continue;
      ++seen;
      const std::string text = text_of(entry.path());
      INFO(entry.path());
      CHECK(complaints("bench.schema.json", json::parse(text, nullptr, true, true)).empty());
      CHECK_NOTHROW(fit::parse_bench(text, entry.path().filename().string()));
    }
  }
  INFO("bench files found: " << seen);
  CHECK(seen > 0);
}

TEST_CASE("The schema and the reader refuse the same wrong bench files") {
  const json good = {{"schema", "bench/1"},
                     {"targets", {{{"name", "board"}, {"from_mm", {1, 2}}, {"to_mm", {3, 4}}}}}};
  REQUIRE(complaints("bench.schema.json", good).empty());
  REQUIRE_NOTHROW(fit::parse_bench(good.dump()));
  std::vector<json> wrong(6, good);
  wrong[0]["schema"] = "bench/2";
  wrong[1]["targets"][0].erase("to_mm");
  wrong[2]["lidar"] = {{"steps", "many"}};
  wrong[3]["lidar"] = {{"mount", {{"x_mm", {{"value", 1}, {"u", -1}}}}}};
  wrong[4]["known"] = {{{"parameters", {{"sigma_mm", 1}}}}};
  wrong[5]["targets"][0]["from_mm"] = {1, 2, 3};
  for (const json& document : wrong) {
    INFO(document.dump());
    CHECK_FALSE(complaints("bench.schema.json", document).empty());
    CHECK_THROWS_AS(fit::parse_bench(document.dump()), std::invalid_argument);
  }
}

TEST_CASE("Every world file of the project satisfies the published schema, and wrong ones do not") {
  int seen = 0;
  for (const auto& entry : std::filesystem::directory_iterator(source_dir / "sim/worlds")) {
    if (!entry.path().string().ends_with(".world.json")) continue;
    ++seen;
    INFO(entry.path());
    CHECK(
        complaints("../sim/worlds/world.schema.json", json::parse(text_of(entry.path()), nullptr, true, true))
            .empty());
  }
  CHECK(seen > 40);
  const json good = {{"schema", "world/1"}, {"bench_file", "room.bench.json"}};
  REQUIRE(complaints("../sim/worlds/world.schema.json", good).empty());
  for (const char* wrong : {R"({"rotor": {"disk_ofset": 1}})", R"({"receiver": {"threshold": -1}})",
                            R"({"pulse": {"shape": "square"}})", R"({"schema": "world/2"})"}) {
    json document = good;
    document.merge_patch(json::parse(wrong));
    CHECK_FALSE(complaints("../sim/worlds/world.schema.json", document).empty());
  }
}

TEST_CASE("The schema and the reader of corrections agree on good and wrong files") {
  fit::Correction correction;
  correction.lidar_model = "UST-10LX";
  correction.session_sha256 = {std::string(64, 'a')};
  correction.zero_mm = {2.5, 0.1};
  fit::CorrectionTerm term;
  term.argument = fit::CorrectionTerm::Argument::range;
  term.family = "line", term.coefficients = {1.5, -0.002};
  term.from = 200, term.to = 9800, term.zero_at = 200;
  correction.range = term;
  correction.validity.beam_deg = fit::Validity::Interval{-0.25, 0.25};
  const auto count = static_cast<Eigen::Index>(correction.parameter_names().size());
  correction.factor = 0.01 * Eigen::MatrixXd::Identity(count, count);
  const json good = json::parse(fit::to_json_text(correction));
  CHECK(complaints("correction.schema.json", good) == "");
  REQUIRE_NOTHROW(fit::parse_correction(good.dump()));
  CHECK(fit::parse_correction(good.dump()).validity.beam_deg->from == -0.25);
  CHECK_FALSE(fit::parse_correction(good.dump()).validity.temperature_c);
  std::vector<json> wrong(7, good);
  wrong[6]["validity"]["beam_deg"] = {{"from", -0.25}};
  wrong[0]["schema"] = "correction/2";
  wrong[1]["terms"][0]["family"] = "lime";
  wrong[2]["terms"][0].erase("from");
  wrong[3]["terms"][0]["coefficients"][0]["value"] = "one";
  wrong[4].erase("reference");
  wrong[5]["covariance_factor"][0][0] = "small";
  for (const json& document : wrong) {
    INFO(document.dump());
    CHECK_FALSE(complaints("correction.schema.json", document).empty());
    CHECK_THROWS_AS(fit::parse_correction(document.dump()), std::invalid_argument);
  }
}

}  // namespace schema_test
