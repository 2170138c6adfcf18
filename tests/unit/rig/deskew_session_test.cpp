// SPDX-License-Identifier: MIT
#include "rig/fitting/deskew_session.hpp"

#include <SQLiteCpp/SQLiteCpp.h>

#include <catch2/catch.hpp>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "rig/errors.hpp"
#include "rig/fitting/fitting.hpp"
#include "rig/session/session_store.hpp"
#include "tests/support/moving_room.hpp"
#include "tests/support/results.hpp"
#include "tests/support/test_folder.hpp"

namespace deskew_session_test {
namespace {

namespace fs = std::filesystem;

constexpr const char* bench =
    R"({"schema": "bench/1", "lidar": {"mount": {"x_mm": 80, "y_mm": 20, "yaw_deg": 0}}})";

/// A session of a stage that turned, told by the capture's rate alone; at rate 0 it stood.
void write_session(const std::string& file, int scans, double rate_deg_s, unsigned seed,
                   const std::vector<room::Wall>& walls = room::furnished()) {
  rig::SessionStore store(file, rig::SessionStore::Mode::create);
  store.set("bench", bench);
  fit::CaptureInfo info;
  info.step = rate_deg_s == 0 ? "stand" : "turn";
  info.started_us = 1'000'000;
  info.stage_rate_rad_s = rate_deg_s * room::deg;
  info.last_step = 1080;
  const auto id = store.begin_capture(info);
  std::mt19937 random(seed);
  const auto lidar_at = [rate_deg_s](double t) {
    const double a = rate_deg_s * room::deg * (t - 1);
    return room::Pose{80 * std::cos(a) - 20 * std::sin(a), 80 * std::sin(a) + 20 * std::cos(a), a};
  };
  for (int i = 0; i < scans; ++i) {
    fit::ScanView view;
    view.seq = i;
    view.host_us = 1'000'000 + 25'000 * i;
    view.device_ms = view.host_us / 1000;
    const auto ranges = room::scan(walls, lidar_at, 1 + 0.025 * i, 5, random);
    view.range_mm = ranges;
    store.add_scan(id, view);
  }
  store.commit_capture(id);
}

void write_turning(const std::string& file, int scans) { write_session(file, scans, 40, 3); }

/// The rms distance from the true walls of scans that nothing distorts, mm.
double distance_of_a_scan_at_rest() {
  const auto walls = room::furnished();
  const room::Pose lidar{80, 20, 0};
  std::mt19937 random(17);
  double sum = 0;
  constexpr int scans = 40;
  for (int i = 0; i < scans; ++i) {
    const auto ranges = room::scan(
        walls, [&](double) { return lidar; }, 0, 5, random);
    std::vector<room::Point> points;
    for (std::size_t k = 0; k < ranges.size(); ++k) {
      if (ranges[k] == 0) continue;
      const double angle = (-135 + 0.25 * static_cast<double>(k)) * room::deg;
      points.push_back(room::placed(lidar, ranges[k] * std::cos(angle), ranges[k] * std::sin(angle)));
    }
    sum += room::rms_from(walls, points, 60) / scans;
  }
  return sum;
}

/// Everything about timing is given, as a simulated path tells it.
rig::DeskewOptions known_timing() {
  rig::DeskewOptions options;
  options.offset_ms = 0;
  options.reversed = false;
  return options;
}

}  // namespace

TEST_CASE("rig deskew writes corrected points of every beam, poses, and pictures of the map") {
  const TestFolder folder;
  write_turning(folder / "in.rig", 80);
  rig::DeskewOptions options;
  options.offset_ms = 0;
  options.reversed = false;
  const std::string made = folder / "out.rig";
  const auto result = rig::deskew_session(folder / "in.rig", rig::check_output({made}), options);
  CHECK(result.at("kind") == "deskew");
  CHECK(result.at("plots").size() >= 4);

  const rig::SessionStore out(made, rig::SessionStore::Mode::read);
  CHECK(out.latest_result("deskew").has_value());
  const auto recording = out.recording();
  CHECK(recording->captures().size() == 1);
  CHECK(recording->track().size() == 160);

  SQLite::Database database(made, SQLite::OPEN_READONLY);
  SQLite::Statement rows(database, "SELECT x_mm, y_mm, heading_deg, points FROM deskewed ORDER BY seq");
  const auto walls = room::furnished();
  int count = 0;
  double squares = 0, points = 0;
  while (rows.executeStep()) {
    const room::Pose at{rows.getColumn(0).getDouble(), rows.getColumn(1).getDouble(),
                        rows.getColumn(2).getDouble() * room::deg};
    REQUIRE(rows.getColumn(3).getBytes() == 1081 * 8);
    std::vector<float> xy(2 * 1081);
    std::memcpy(xy.data(), rows.getColumn(3).getBlob(), xy.size() * sizeof(float));
    for (std::size_t k = 0; k < 1081; ++k) {
      if (!std::isfinite(xy[2 * k])) continue;
      const double d = room::distance_from(
          walls, room::placed(at, static_cast<double>(xy[2 * k]), static_cast<double>(xy[2 * k + 1])));
      squares += d * d;
      points += 1;
    }
    ++count;
  }
  CHECK(count == 80);
  CHECK(std::sqrt(squares / points) < 6.5);  // the noise is 5 mm, whole millimetres
}

TEST_CASE("rig deskew refuses what does not tell how the lidar moved, and leaves existing files alone") {
  const TestFolder folder;
  {
    rig::SessionStore store(folder / "empty.rig", rig::SessionStore::Mode::create);
    store.set("bench", bench);
  }
  CHECK_THROWS_AS(rig::deskew_session(folder / "empty.rig", rig::check_output({folder / "out.rig"}), {}),
                  rig::MeasurementError);
  CHECK_FALSE(fs::exists(folder / "out.rig"));
  write_turning(folder / "in.rig", 6);
  write_turning(folder / "there.rig", 6);
  CHECK_THROWS_AS(rig::deskew_session(folder / "in.rig", rig::check_output({folder / "there.rig"}), {}),
                  rig::UsageError);
}

TEST_CASE("rig deskew --reference tells how far scans are from the scene at rest, before and after") {
  const TestFolder folder;
  write_turning(folder / "turn.rig", 100);
  write_session(folder / "rest.rig", 200, 0, 9);
  rig::DeskewOptions options = known_timing();
  options.reference = std::make_shared<const rig::DeskewReference>(folder / "rest.rig");
  const auto result =
      rig::deskew_session(folder / "turn.rig", rig::check_output({folder / "out.rig"}), options);
  const fit::Estimate before = value_of(result, "reference_before_mm"),
                      by_path = value_of(result, "reference_by_path_mm"),
                      fused = value_of(result, "reference_fused_mm"),
                      gain = value_of(result, "reference_gain_mm");
  INFO(before.value << " " << by_path.value << " " << fused.value << " " << gain.value);
  // A scan at rest, by the room itself: noise along slanting beams counts less across the walls.
  const double at_rest = distance_of_a_scan_at_rest();
  CHECK(by_path.value == Approx(at_rest).margin(0.15));
  CHECK(fused.value == Approx(at_rest).margin(0.15));
  CHECK(before.value - by_path.value > 6 * std::hypot(before.u, by_path.u));
  CHECK(gain.value == Approx(before.value - fused.value).margin(1e-9));
  CHECK(gain.u > 0);
  CHECK(gain.u < before.u + fused.u);
  CHECK_FALSE(result.at("budget").empty());
}

TEST_CASE("a reference of another scene, without scans at rest, or that is none is refused with what to do") {
  const TestFolder folder;
  write_turning(folder / "turn.rig", 20);
  const auto deskew_by = [&](const std::string& reference) {
    rig::DeskewOptions options = known_timing();
    options.reference = std::make_shared<const rig::DeskewReference>(reference);
    return rig::deskew_session(folder / "turn.rig", rig::check_output({folder / "out.rig"}), options);
  };
  const std::vector<room::Wall> elsewhere{{{-9000, -9000}, {9000, -9000}}, {{-9000, -9000}, {-9000, 9000}}};
  write_session(folder / "elsewhere.rig", 30, 0, 9, elsewhere);
  CHECK_THROWS_WITH(deskew_by(folder / "elsewhere.rig"), Catch::Contains("it must show the same scene"));
  CHECK_THROWS_WITH(deskew_by(folder / "turn.rig"), Catch::Contains("has no scan at rest"));
  CHECK_THROWS_WITH(deskew_by("0,0,90"), Catch::Contains("has no scan at rest"));
  CHECK_THROWS_WITH(deskew_by(folder / "missing.rig"), Catch::Contains("neither a session file nor a pose"));
  CHECK_THROWS_AS(deskew_by("0;0;90"), rig::UsageError);
  CHECK_FALSE(fs::exists(folder / "out.rig"));
}

TEST_CASE("the gain against a reference is covered by k = 2 over seeds") {
  const TestFolder folder;
  write_session(folder / "rest.rig", 200, 0, 99);
  std::vector<fit::Estimate> gains;
  for (unsigned seed = 1; seed <= 12; ++seed) {
    const std::string file = folder / "turn.rig", out = folder / "out.rig";
    fs::remove(file), fs::remove(out);
    write_session(file, 60, 40, seed);
    rig::DeskewOptions options = known_timing();
    options.fuse = false;
    options.reference = std::make_shared<const rig::DeskewReference>(folder / "rest.rig");
    gains.push_back(
        value_of(rig::deskew_session(file, rig::check_output({out}), options), "reference_gain_mm"));
  }
  // The same motion with other noise: the gains' own mean is the truth that they scatter about.
  double mean = 0;
  for (const auto& gain : gains) mean += gain.value / static_cast<double>(gains.size());
  int inside = 0;
  for (const auto& gain : gains) inside += std::abs(gain.value - mean) < 2 * gain.u;
  INFO("inside: " << inside << " of " << gains.size());
  CHECK(inside >= 9);
}

}  // namespace deskew_session_test
