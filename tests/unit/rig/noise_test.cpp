// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>

#include "rig/errors.hpp"
#include "rig/fitting/fitting.hpp"
#include "tests/support/results.hpp"
#include "tests/support/test_folder.hpp"

namespace noise_test {
namespace {

constexpr const char* plain_bench = R"({"schema": "bench/1",
  "targets": [{"name": "board", "from_mm": [1400, -200], "to_mm": [1400, 200]}]})";

/// A recording of some beams, each sample at its range with normal noise, in whole millimetres.
class Recorded {
 public:
  Recorded(const std::string& path, unsigned seed, const std::string& serial = "H1",
           const char* bench = plain_bench)
      : path_(path), random_(seed) {
    std::filesystem::remove(path);
    store_ = std::make_unique<rig::SessionStore>(path, rig::SessionStore::Mode::create);
    store_->set("bench", bench);
    store_->set("lidar", nlohmann::json({{"PROD", "UST-10LX"}, {"SERI", serial}}).dump());
  }
  /// `speed_mm_s`: of all surfaces towards the lidar.
  void capture(int beams, long scans, double sigma_mm, double rate_deg_s = 0, double speed_mm_s = 0) {
    fit::CaptureInfo info;
    info.step = "stand";
    info.stage_rate_rad_s = rate_deg_s * std::numbers::pi / 180;
    info.last_step = beams - 1;
    const auto id = store_->begin_capture(info);
    std::normal_distribution<double> normal;
    std::vector<std::uint16_t> ranges(static_cast<std::size_t>(beams));
    for (long seq = 0; seq < scans; ++seq) {
      for (auto& range : ranges)
        range = static_cast<std::uint16_t>(
            std::lround(2000.3 - speed_mm_s * 0.025 * static_cast<double>(seq) + sigma_mm * normal(random_)));
      store_->add_scan(id, {seq, seq * 25, seq * 25000, ranges, {}, {}});
    }
    store_->commit_capture(id);
  }
  rig::SessionStore& store() { return *store_; }
  [[nodiscard]] rig::FitSource source() const { return {path_, store_.get()}; }

 private:
  std::string path_;
  std::mt19937_64 random_;
  std::unique_ptr<rig::SessionStore> store_;
};

nlohmann::json noise_of(const std::vector<rig::FitSource>& sources) {
  return rig::run_fit("noise", sources, nullptr);
}

}  // namespace

TEST_CASE("noise: k = 2 covers the truth 90 to 99 % of the time over 200 seeds") {
  const TestFolder folder;
  constexpr unsigned seeds = 200;
  constexpr double sigma = 8, rounded = 1.0 / 12;
  int sigma_inside = 0, correlation_inside = 0;
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    Recorded session(folder / "noise.rig", seed);
    session.capture(120, 40, sigma);
    const auto result = noise_of({session.source()});
    const fit::Estimate found = value_of(result, "noise_median_mm");
    sigma_inside += std::abs(found.value - std::sqrt(sigma * sigma + rounded)) < 2 * found.u;
    const fit::Estimate correlation = value_of(result, "scan_correlation");
    correlation_inside += std::abs(correlation.value) < 2 * correlation.u;
  }
  INFO("covered: " << sigma_inside << " and " << correlation_inside << " of " << seeds);
  CHECK(sigma_inside >= 180);
  CHECK(sigma_inside <= 198);
  CHECK(correlation_inside >= 180);
  CHECK(correlation_inside <= 198);
}

TEST_CASE("noise: sessions of one lidar before one scene are taken together, others are refused") {
  const TestFolder folder;
  Recorded a(folder / "a.rig", 1), b(folder / "b.rig", 2), other_lidar(folder / "c.rig", 3, "H2"),
      other_scene(folder / "d.rig", 4, "H1", R"({"schema": "bench/1", "targets": []})"),
      other_pattern(folder / "e.rig", 5, "H1",
                    R"({"schema": "bench/1", "lidar": {"steps": 541, "step_deg": 0.5, "front_step": 270},
        "targets": [{"name": "board", "from_mm": [1400, -200], "to_mm": [1400, 200]}]})");
  for (Recorded* session : {&a, &b, &other_lidar, &other_scene, &other_pattern}) session->capture(60, 50, 5);
  const double alone = value_of(noise_of({a.source()}), "noise_median_mm").u;
  const double together = value_of(noise_of({a.source(), b.source()}), "noise_median_mm").u;
  CHECK(together < alone);
  const auto refused = [&](Recorded& other, const char* what) {
    CHECK_THROWS_WITH(noise_of({a.source(), other.source()}),
                      Catch::Contains(what) && Catch::Contains("Fit each session by itself"));
  };
  refused(other_lidar, "their lidars differ (UST-10LX H1; UST-10LX H2)");
  refused(other_scene, "their targets differ (board from (1400, -200) to (1400, 200) mm; nothing)");
  refused(other_pattern, "their scan patterns differ (1081 beams of 0.25 deg at 40 Hz; 541 beams");
}

TEST_CASE("a calibration for single beams refuses captures in clusters, by name and with what to do") {
  const TestFolder folder;
  Recorded session(folder / "clusters.rig", 1);
  session.capture(60, 50, 5);
  CHECK_NOTHROW(noise_of({session.source()}));
  fit::CaptureInfo merged;
  merged.step = "merged", merged.last_step = 59, merged.cluster = 3;
  session.store().commit_capture(session.store().begin_capture(merged));
  CHECK_THROWS_AS(noise_of({session.source()}), rig::UsageError);
  CHECK_THROWS_WITH(noise_of({session.source()}), Catch::Contains("capture 2 ('merged')") &&
                                                      Catch::Contains("clusters of 3") &&
                                                      Catch::Contains("cluster: 1"));
}

TEST_CASE("noise: captures during which the lidar moved are no noise, however the session tells it") {
  const TestFolder folder;
  Recorded session(folder / "moving.rig", 1);
  SECTION("the stage turned") { session.capture(60, 50, 5, 30); }
  SECTION("odometry says so") {
    session.capture(60, 50, 5);
    for (int i = 0; i <= 10; ++i) {
      fit::TrackPose pose;
      pose.host_us = 100'000 * i, pose.x_mm = 10.0 * i, pose.y_mm = 0, pose.heading_rad = 0;
      session.store().add_pose(pose);
    }
  }
  SECTION("only the ranges show it") { session.capture(60, 200, 5, 0, 100); }
  CHECK_THROWS_WITH(noise_of({session.source()}), Catch::Contains("the lidar moved during every capture") &&
                                                      Catch::Contains("Capture at rest"));
  CHECK_THROWS_AS(noise_of({session.source()}), rig::MeasurementError);
  if (session.store().recording()->track().empty()) {
    session.capture(60, 200, 5);
    const auto result = noise_of({session.source()});
    CHECK(value_of(result, "noise_median_mm").value == Approx(5).margin(0.3));
    CHECK_THAT(result.at("notes").dump(),
               Catch::Contains("Captures during which the lidar moved are left out, 1"));
  }
}

TEST_CASE("noise: a slow drift of a resting lidar's range is not taken for a motion") {
  const TestFolder folder;
  Recorded session(folder / "drift.rig", 1);
  session.capture(60, 2000, 5, 0, 0.4);  // 20 mm within 50 s
  CHECK_NOTHROW(noise_of({session.source()}));
}

}  // namespace noise_test
