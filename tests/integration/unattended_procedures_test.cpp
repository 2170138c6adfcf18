// SPDX-License-Identifier: MIT
// Procedures as operators run them, on a simulated bench that is not quite as its bench file says.
#include <catch2/catch.hpp>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>

#include "rig/session/session_store.hpp"
#include "tests/support/programs.hpp"
#include "tests/support/results.hpp"

namespace unattended_procedures_test {
namespace {

const std::string procedures = RIG_SOURCE_DIR "/procedures/";

/// `rig run` of a procedure from its first step to its last, beside a simulator of the true bench.
class Unattended {
 public:
  Unattended(const std::string& bench, const std::string& truth, const std::string& speed = "max")
      : bench_(procedures + bench) {
    std::ofstream(folder_ / "truth.json") << truth;
    sim_.emplace(folder_, folder_ / "truth.json", std::vector<std::string>{"--seed", "7", "--speed", speed});
  }

  void run(const std::string& procedure, std::vector<std::string> settings) {
    std::vector<std::string> words = {
        RIG_BIN_DIR "/rig", "run",     procedures + procedure, "--bench",    bench_,         "--lidar",
        sim_->lidar(),      "--stage", sim_->stage(),          "--operator", sim_->person(), "--out",
        session()};
    for (std::string& setting : settings) words.insert(words.end(), {"--set", std::move(setting)});
    Program rig(words, folder_);
    const int status = rig.exit_status(std::chrono::seconds(120));
    INFO(rig.errors());
    REQUIRE(status == 0);
  }
  [[nodiscard]] fit::Estimate value(const std::string& kind, const std::string& name) const {
    return value_of(latest_result(session(), kind), name);
  }
  [[nodiscard]] std::string text_of(const std::string& file) const { return file_text(folder_ / file); }

 private:
  [[nodiscard]] std::string session() const { return folder_ / "out.rig"; }
  TestFolder folder_;
  std::string bench_;
  std::optional<SimProgram> sim_;
};

}  // namespace

TEST_CASE("a corner gives the lidar's place and orientation within what is stated") {
  Unattended bench("corner.bench.json", R"({"schema": "bench/1",
    "lidar": {"model": "UST-10LX", "steps": 1081, "front_step": 540, "step_deg": 0.25, "scan_hz": 40,
              "mount": {"x_mm": 52, "y_mm": -9, "yaw_deg": 1.3}},
    "stage": {"resolution_deg": 0.01, "limits_deg": [-170, 170], "speed_deg_s": 30},
    "targets": [{"name": "front", "from_mm": [1503, -1500], "to_mm": [1503, 1500], "reflectance": 0.8},
                {"name": "side", "from_mm": [1503, 1498], "to_mm": [-1500, 1498], "reflectance": 0.8}],
    "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": 8}}]})");
  bench.run("right-angle-wall.yaml", {"samples=50"});
  const auto is = [&](const std::string& name, double truth) {
    const fit::Estimate found = bench.value("wall", name);
    INFO(name << ": " << found.value << " +/- " << found.u);
    CHECK(found.u > 0);
    CHECK(std::abs(found.value - truth) < 4 * found.u);
    return found.u;
  };
  // The bench file states no accuracy: an encoder may be off by 0.15 deg, ranges by 12 mm and in proportion.
  CHECK(is("mounting_angle_deg", 1.3) < 0.15);
  CHECK(is("mount_x_mm", 52) < 0.4);
  CHECK(is("mount_y_mm", -9) < 0.4);
  CHECK(is("radius_mm", std::hypot(52, 9)) < 0.4);
  CHECK(is("direction_deg", std::atan2(-9, 52) * 180 / std::numbers::pi) < 0.4);
  CHECK(is("front_mm", 1503) < 20);
  CHECK(is("front_mm", 1503) > 5);
  CHECK(is("side_mm", 1498) < 20);
  CHECK(is("corner_deg", 90) < 0.05);
  CHECK_THAT(bench.text_of("right-angle-wall.html"), Catch::Contains("Mounting angle"));
}

TEST_CASE("a board's edge gives the rotation centre within what is stated") {
  Unattended bench("demo.bench.json", file_text(procedures + "demo.truth.bench.json"));
  bench.run("rotation-centre.yaml", {"samples=1000", "edge_samples=200"});
  const auto truth =
      nlohmann::json::parse(file_text(procedures + "demo.truth.bench.json"), nullptr, true, true)
          .at("lidar")
          .at("mount");
  const auto of = [&](const char* name) {
    return truth.at(name).is_object() ? truth.at(name).at("value").get<double>()
                                      : truth.at(name).get<double>();
  };
  const double yaw = of("yaw_deg") * std::numbers::pi / 180;
  // The axis as the lidar sees it: the way back along its mount.
  const double x = -(std::cos(yaw) * of("x_mm") + std::sin(yaw) * of("y_mm")),
               y = -(std::cos(yaw) * of("y_mm") - std::sin(yaw) * of("x_mm"));
  const fit::Estimate found_x = bench.value("centre", "centre_x_mm"),
                      found_y = bench.value("centre", "centre_y_mm");
  INFO(found_x.value << " +/- " << found_x.u << ", " << found_y.value << " +/- " << found_y.u);
  CHECK(std::abs(found_x.value - x) < 4 * found_x.u);
  CHECK(std::abs(found_y.value - y) < 4 * found_y.u);
  CHECK(found_x.u < 1);
  CHECK(found_y.u < 1);
}

TEST_CASE("a turning stage distorts scans, and its rate takes the distortion out again") {
  // In real time: at full speed nobody can say when a beam met what, while the stage turned.
  Unattended bench("corner.bench.json", R"({"schema": "bench/1",
    "lidar": {"model": "UST-10LX", "steps": 1081, "front_step": 540, "step_deg": 0.25, "scan_hz": 40,
              "mount": {"x_mm": 45, "y_mm": 12, "yaw_deg": 0.7}},
    "stage": {"resolution_deg": 0.01, "limits_deg": [-170, 170], "speed_deg_s": 30},
    "targets": [{"name": "front", "from_mm": [1500, -1500], "to_mm": [1500, 1500], "reflectance": 0.8},
                {"name": "side", "from_mm": [1500, 1500], "to_mm": [-1500, 1500], "reflectance": 0.8}],
    "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": 2}}]})",
                   "real");
  bench.run("motion-distortion.yaml", {"samples=25", "from_deg=-12"});
  const fit::Estimate at_rest = bench.value("deskew", "shape_at_rest_mm"),
                      turning = bench.value("deskew", "shape_turning_mm"),
                      by_stage = bench.value("deskew", "shape_by_stage_mm"),
                      fused = bench.value("deskew", "shape_fused_mm");
  INFO(at_rest.value << ", " << turning.value << " -> " << by_stage.value << ", " << fused.value << " mm");
  // 0.56 deg within a scan bends the walls by more than a millimetre.
  CHECK(turning.value > std::hypot(at_rest.value, 1.0));
  CHECK(by_stage.value < std::hypot(at_rest.value, 0.5));
  CHECK(fused.value < std::hypot(at_rest.value, 0.5));
  // Only what is at rest tells the noise.
  CHECK(bench.value("noise", "noise_median_mm").value == Approx(2).margin(0.3));
  CHECK_THAT(bench.text_of("motion-distortion.html"), Catch::Contains("as seen at rest"));
}

}  // namespace unattended_procedures_test
