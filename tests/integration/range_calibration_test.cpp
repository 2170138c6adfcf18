// SPDX-License-Identifier: MIT
#include <unistd.h>
#include <yaml-cpp/yaml.h>

#include <catch2/catch.hpp>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <sstream>

#include "fit/correction.hpp"
#include "fit/family.hpp"
#include "rig/errors.hpp"
#include "rig/export/exporter.hpp"
#include "rig/fitting/apply_session.hpp"
#include "rig/fitting/correction_source.hpp"
#include "rig/fitting/fitting.hpp"
#include "tests/support/test_folder.hpp"

namespace {

namespace fs = std::filesystem;

/// What the simulated lidar gets wrong: the published distance error (source A, equation 15) and a confluent
/// exponential of the echo's strength.
double distance_error(double mm) {
  const double w = -1.341e-4;
  return 919.7 - 966.6 * std::cos(w * mm) + 52.28 * std::cos(2 * w * mm) + 777 * std::sin(w * mm) -
         326.3 * std::sin(2 * w * mm);
}
double intensity_error(double counts) { return (25 - 0.012 * counts) * std::exp(-0.0016 * counts); }
double counts_of(double reflectance, double mm) {
  return 2400 * reflectance * (1 + std::pow(200 / 3000.0, 2)) / (1 + std::pow(mm / 3000, 2));
}

constexpr const char* bench_text = R"({"schema": "bench/1",
  "lidar": {"model": "UST-10LX", "steps": 1081, "front_step": 540, "step_deg": 0.25, "scan_hz": 40,
            "mount": {"x_mm": 0, "y_mm": 0, "yaw_deg": {"value": 0, "u": 0.1}}},
  "targets": [{"name": "sample", "from_mm": [200, -100], "to_mm": [200, 100], "u_mm": 0, "u_deg": 0.1}]})";

/// A session of captures by the beam straight ahead.
class Ladder {
 public:
  Ladder(const std::string& path, unsigned seed, double sigma_mm)
      : path_(path), random_(seed), sigma_(sigma_mm) {
    fs::remove(path);
    store_ = std::make_unique<rig::SessionStore>(path, rig::SessionStore::Mode::create);
    store_->set("bench", bench_text);
    store_->set("lidar", R"({"PROD":"UST-10LX","SERI":"H1234567","FIRM":"1.2"})");
    store_->set("created_utc", "2026-05-04T10:00:00Z");
    store_->set("procedure_name", "simulated ladder");
  }
  void capture(double mm, double reflectance, long scans) {
    fit::CaptureInfo info;
    info.step = "at " + std::to_string(static_cast<int>(mm));
    info.target = "sample", info.target_shift_mm = mm - 200, info.reflectance = reflectance;
    info.first_step = info.last_step = 540;
    const auto id = store_->begin_capture(info);
    std::normal_distribution<double> normal;
    const double counts = counts_of(reflectance, mm);
    for (long seq = 0; seq < scans; ++seq) {
      const double shown = std::max(1.0, std::round(counts * (1 + 0.01 * normal(random_))));
      const double range = mm + distance_error(mm) + intensity_error(shown) + sigma_ * normal(random_);
      const std::uint16_t r = static_cast<std::uint16_t>(std::lround(range)),
                          i = static_cast<std::uint16_t>(shown);
      store_->add_scan(id, {seq, seq * 25, seq * 25000, {&r, 1}, {&i, 1}, {}});
    }
    store_->commit_capture(id);
  }
  rig::SessionStore& store() { return *store_; }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  std::mt19937_64 random_;
  double sigma_;
  std::unique_ptr<rig::SessionStore> store_;
};

const std::vector<double> surfaces = {0.99, 0.85, 0.70, 0.55, 0.42, 0.31, 0.22, 0.14, 0.08, 0.04};

void measure(Ladder& a1, Ladder& a2, long samples_a1, long samples_a2) {
  for (const double reflectance : surfaces) a1.capture(200, reflectance, samples_a1);
  for (int i = 2; i <= 98; ++i) a2.capture(100.0 * i, 0.85, samples_a2);
}

nlohmann::json fit_both(Ladder& a1, Ladder& a2, const nlohmann::json& options = nlohmann::json::object()) {
  return rig::run_fit("range", {{a1.path(), &a1.store()}, {a2.path(), &a2.store()}}, options);
}

/// Largest deviation of the correction from the truth over the region the ladders cover, and how often the
/// k = 2 band holds it.
struct Judged {
  double worst_mm = 0, covered = 0;
};
Judged judge(const fit::Correction& correction) {
  Judged out;
  int inside = 0, all = 0;
  const auto look = [&](double mm, double reflectance) {
    const double counts = counts_of(reflectance, mm), truth = distance_error(mm) + intensity_error(counts);
    const double off = correction.apply(mm + truth, counts).error_mm - truth;
    out.worst_mm = std::max(out.worst_mm, std::abs(off));
    inside += std::abs(off) < 2 * correction.u(mm + truth, counts), ++all;
  };
  for (double mm = 200; mm <= 9800; mm += 50) look(mm, 0.85);
  for (double reflectance = 0.04; reflectance <= 0.99; reflectance += 0.01) look(200, reflectance);
  // Other surfaces elsewhere, as far as their echo's strength was covered.
  for (double mm = 400; mm <= 3000; mm += 200)
    for (double reflectance = 0.2; reflectance < 0.95; reflectance += 0.15) look(mm, reflectance);
  out.covered = static_cast<double>(inside) / all;
  return out;
}

fit::Correction correction_in(const nlohmann::json& result) {
  return fit::parse_correction(result.at("data").at("correction").dump());
}

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
  c.intensity = fit::CorrectionTerm{
      fit::CorrectionTerm::Argument::intensity, intensity, coefficients.at(intensity), 200, 2400, 2399.5};
  c.range = fit::CorrectionTerm{
      fit::CorrectionTerm::Argument::range, range, coefficients.at(range), 210.5, 9700, {}};
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

TEST_CASE(
    "range calibration: both errors of a simulated lidar are recovered within 0.5 mm, and the band covers "
    "them") {
  const TestFolder place;
  Ladder a1(place / "a1.rig", 1, 3), a2(place / "a2.rig", 2, 3);
  measure(a1, a2, 5000, 1000);
  const auto result = fit_both(a1, a2);
  const fit::Correction correction = correction_in(result);
  const Judged judged = judge(correction);
  INFO(correction.intensity->family << " and " << correction.range->family);
  CHECK(judged.worst_mm < 0.5);
  CHECK(judged.covered > 0.85);
  CHECK(correction.lidar_serial == "H1234567");
  CHECK(correction.session_sha256.size() == 2);
  CHECK(correction.lidar_model == "UST-10LX");
  CHECK(correction.lidar_firmware == "1.2");
  CHECK(correction.created_utc == "2026-05-04T10:00:00Z");
  REQUIRE(correction.validity.range_mm);
  CHECK(correction.validity.range_mm->from == 200);
  CHECK(correction.validity.range_mm->to == 9800);
  REQUIRE(correction.validity.beam_deg);
  CHECK(correction.validity.beam_deg->holds(0));
  CHECK_FALSE(correction.validity.beam_deg->holds(0.3));
  CHECK_FALSE(correction.validity.temperature_c);
  CHECK_THAT(result.at("undetermined").dump(), Catch::Contains("at which temperature the correction holds"));
  CHECK_FALSE(correction.apply(50, 1000).inside());
  CHECK(correction.apply(50, 1000).range_outside);
  CHECK(correction.apply(1000, 4000).intensity_outside);

  // The session corrected, and calibrated again: nothing is left beyond the rounding of the format.
  a2.store().add_result("range", result.dump());
  rig::ApplyRequest request;
  request.correction = rig::load_correction(a2.path(), a2.store());
  request.correction_name = "a2.rig", request.input = a2.path(),
  request.output = rig::check_output({place / "corrected.rig"});
  const auto report = rig::apply_to_session(request);
  CHECK(report.samples == 97 * 1000);
  CHECK(report.outside_range < 0.02 * 97000);
  const rig::SessionStore corrected(request.output.path(), rig::SessionStore::Mode::read);
  const auto again = rig::run_fit("range", {{request.output.path(), &corrected}}, nlohmann::json::object());
  for (const auto& value : again.at("values"))
    if (value.at("name") == "rms_error_before_mm") CHECK(value.at("value").get<double>() < 0.3);
  CHECK_FALSE(corrected.latest_result("range"));
  request.input = request.output.path(), request.output = rig::check_output({place / "twice.rig"});
  CHECK_THROWS_WITH(rig::apply_to_session(request), Catch::Contains("corrected already"));
}

TEST_CASE("range calibration: 97 x 10,000 and 10 x 50,000 samples", "[.full]") {
  const TestFolder place;
  Ladder a1(place / "a1.rig", 3, 8), a2(place / "a2.rig", 4, 8);
  measure(a1, a2, 50000, 10000);
  const auto begun = std::chrono::steady_clock::now();
  const auto result = fit_both(a1, a2);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  const Judged judged = judge(correction_in(result));
  WARN("largest deviation " << judged.worst_mm << " mm, covered " << 100 * judged.covered << " %, fitted in "
                            << seconds << " s");
  CHECK(judged.worst_mm < 0.5);
}

TEST_CASE("range calibration: over seeds the k = 2 band holds the truth about as often as it says") {
  const TestFolder place;
  double covered = 0;
  constexpr unsigned seeds = 8;
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    Ladder a1(place / "a1.rig", 100 + seed, 3), a2(place / "a2.rig", 200 + seed, 3);
    measure(a1, a2, 400, 100);
    covered += judge(correction_in(fit_both(
                         a1, a2, {{"intensity", "confluent-exponential"}, {"distance", "fourier-2"}})))
                   .covered /
               seeds;
  }
  INFO("covered " << covered);
  // Points of one curve go together: eight curves say little more than eight draws.
  CHECK(covered > 0.85);
}

TEST_CASE("range calibration: what surfaces did not cover is said, and a misspelt family is refused") {
  const TestFolder place;
  Ladder a1(place / "a1.rig", 1, 3), a2(place / "a2.rig", 2, 3);
  for (const double reflectance : {0.99, 0.9, 0.8, 0.7, 0.6, 0.5}) a1.capture(200, reflectance, 300);
  for (int i = 2; i <= 98; i += 4) a2.capture(100.0 * i, 0.85, 300);
  const auto result = fit_both(a1, a2);
  CHECK_THAT(result.at("undetermined").dump(),
             Catch::Contains("only the sum of intensity and distance error is known"));
  CHECK_THROWS_AS(fit_both(a1, a2, {{"distance", "furier"}}), rig::UsageError);
  CHECK_NOTHROW(fit_both(a1, a2, {{"intensity", "constant"}}));  // A curve without a shape of its own.
  CHECK_THROWS_AS(fit_both(a1, a2, {{"selection", "all"}}), rig::UsageError);
}

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
  while (std::getline(table, line)) {
    std::istringstream cells(line);
    double range = 0, counts = 0, corrected = 0, u = 0;
    char comma = 0;
    REQUIRE(cells >> range >> comma >> counts >> comma >> corrected >> comma >> u);
    if (++rows % 97 != 0) continue;
    CHECK(c.apply(range, counts).range_mm == Approx(corrected).margin(1e-9));
    CHECK(c.u(range, counts) == Approx(u).epsilon(1e-6));
  }
  CHECK(rows == 201 * 101);

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
  request.correction.lidar_model = "UTM-30LX";
  CHECK_THROWS_WITH(rig::apply_to_session(request), Catch::Contains("UTM-30LX"));
}

TEST_CASE("range procedures run unattended on the simulated bench and lead to a correction that validates") {
  const TestFolder place;
  const std::string procedures = std::string(RIG_SOURCE_DIR) + "/procedures", bin = RIG_BIN_DIR;
  auto truth = nlohmann::json::parse(file_text(procedures + "/range.bench.json"), nullptr, true, true);
  truth["known"] = {
      {{"mechanism", "range-noise"}, {"parameters", {{"sigma_mm", 3}}}},
      {{"mechanism", "range-walk"}, {"parameters", {{"amplitude_mm", 30}, {"intensity_scale", 500}}}},
      {{"mechanism", "range-scale"}, {"parameters", {{"scale", 0.002}}}}};
  std::ofstream(place / "truth.json") << truth.dump();
  const std::string script = R"sh(set -eu
cd "$1"; bin=$2; procedures=$3
coproc sim { exec "$bin/rig-sim" --bench "$procedures/range.bench.json" --truth truth.json --lidar-port 0 --stage-link ./stage \
  --speed max --seed 5 2>sim.log; }
trap 'kill "$sim_PID" 2>/dev/null || true' EXIT
IFS= read -r -t 20 ready <&"${sim[0]}"
value() { sed -n "s/.*\"$1\": *\"\([^\"]*\)\".*/\1/p" <<<"$ready"; }
run() {
  "$bin/rig" run "$procedures/$1" --lidar "$(value lidar)" --stage "$(value stage)" --operator "$(value operator)" \
    --bench "$procedures/range.bench.json" --out "$2" "${@:3}"
}
run range-intensity.yaml a1.rig --set samples=400
run range-distance.yaml a2.rig --set samples=200 --set spacing_s=0 --set step_mm=800
run range-ladder.yaml ladder.rig --set samples=1000
"$bin/rig" fit range ladder.rig --json ladder.json
"$bin/rig" fit range a1.rig a2.rig --json fit.json
"$bin/rig" export a1.rig --format correction -o correction.json
run range-validation.yaml a3.rig --set samples=100 --set correction=correction.json
"$bin/rig" fit validation a3.rig --option correction=correction.json --json validation.json
"$bin/rig" apply correction.json a2.rig -o corrected.rig --json apply.json
"$bin/rig" report a1.rig -o a1.html
)sh";
  std::ofstream(place / "run") << script;
  const int status = std::system(("bash " + place / "run" + " " + place.path() + " " + bin + " " +
                                  procedures + " >" + place / "log" + " 2>&1")
                                     .c_str());
  INFO(file_text(place / "log") << file_text(place / "sim.log"));
  REQUIRE(status == 0);
  const auto result = nlohmann::json::parse(file_text(place / "fit.json"));
  double before = 0, after = 0;
  for (const auto& value : result.at("values")) {
    if (value.at("name") == "rms_error_before_mm") before = value.at("value").get<double>();
    if (value.at("name") == "rms_error_after_mm") after = value.at("value").get<double>();
  }
  CHECK(before > 5);
  CHECK(after < 1);
  const fit::Correction correction = correction_in(result);
  REQUIRE(correction.intensity);
  REQUIRE(correction.range);
  // Where this short run measured: between its first two distances, 800 mm apart, several curves fit alike.
  for (const double mm : {200.0, 1500.0, 5000.0, 9500.0}) {
    const double counts = counts_of(0.85, mm), error = 30 * std::exp(-counts / 500) + 0.002 * mm;
    CHECK(correction.apply(mm + error, counts).range_mm == Approx(mm).margin(1));
  }
  // Twelve captures in one session: walk and scale come apart where they were measured.
  const fit::Correction ladder = correction_in(nlohmann::json::parse(file_text(place / "ladder.json")));
  REQUIRE(ladder.intensity);
  REQUIRE(ladder.range);
  for (const double mm : {200.0, 350.0, 800.0, 2000.0, 5000.0})
    for (const double reflectance : {0.85, 0.2}) {
      if (mm > 2000 && reflectance < 0.5) continue;  // Weaker than any echo of the procedure.
      const double counts = counts_of(reflectance, mm), error = 30 * std::exp(-counts / 500) + 0.002 * mm;
      INFO(mm << " mm, reflectance " << reflectance);
      CHECK(ladder.apply(mm + error, counts).range_mm == Approx(mm).margin(1.5));
    }
  const auto validation = nlohmann::json::parse(file_text(place / "validation.json"));
  CHECK(validation.at("tables").at(0).at("rows").size() >= 4);
  // Most of the board is seen by other beams than the one that the correction was measured with.
  CHECK_THAT(
      validation.at("notes").dump(),
      Catch::Contains("of the beams lie outside the beam directions that the correction was measured over") &&
          Catch::Contains("by the bench file's mount"));
  std::string titles;
  for (const auto& plot : validation.at("plots")) {
    titles += plot.at("title").get<std::string>() + "; ";
    CHECK(plot.at("series").size() == 2);
  }
  CHECK_THAT(titles, Catch::Contains("difference from the 20th point before") &&
                         Catch::Contains("Experiment A6: the same, range and centre corrected"));
  for (const auto& value : validation.at("values")) CHECK(value.at("u").is_number());
  CHECK_FALSE(validation.at("budget").empty());
  CHECK_THAT(validation.at("values").dump(),
             Catch::Contains("spread_20_after_mm") && Catch::Contains("scene_after_mm"));
  const rig::SessionStore run(place / "a3.rig", rig::SessionStore::Mode::read);
  CHECK_THAT(run.latest_result("validation").value_or(""), Catch::Contains("spread_20_after_mm"));
  CHECK(nlohmann::json::parse(file_text(place / "apply.json")).at("samples").get<long>() > 1000);
}
