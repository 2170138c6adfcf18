// SPDX-License-Identifier: MIT
// Range errors of a simulated lidar, calibrated from sessions and from procedures.
#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "fit/range/correction.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/apply_session.hpp"
#include "rig/fitting/correction_source.hpp"
#include "rig/fitting/fitting.hpp"
#include "tests/support/range_ladder.hpp"
#include "tests/support/test_folder.hpp"

namespace range_calibration_test {

using namespace range_ladder;

namespace {

namespace fs = std::filesystem;

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
  REQUIRE_FALSE(report.warnings.empty());
  CHECK_THAT(report.warnings.back(), Catch::Contains("From a report, not from a certificate"));
  CHECK(report.samples == 97 * 1000);
  CHECK(report.outside_range < 0.002 * 97000);  // Of two borders, a thousandth each lies beyond.
  const rig::SessionStore corrected(request.output.path(), rig::SessionStore::Mode::read);
  const auto again = rig::run_fit("range", {{request.output.path(), &corrected}}, nlohmann::json::object());
  const auto& values = again.at("values");
  const auto before = std::ranges::find_if(
      values, [](const auto& value) { return value.at("name") == "rms_error_before_mm"; });
  REQUIRE(before != values.end());
  CHECK(before->at("value").get<double>() < 0.3);
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
  // In one session: walk and scale come apart where they were measured.
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

}  // namespace range_calibration_test
