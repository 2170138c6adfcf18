// SPDX-License-Identifier: MIT
#include "rig/fitting/deskew_session.hpp"

#include <SQLiteCpp/SQLiteCpp.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "rig/errors.hpp"
#include "rig/session/session_store.hpp"
#include "tests/support/moving_room.hpp"

namespace {

namespace fs = std::filesystem;

struct Folder {
  Folder() : path(fs::temp_directory_path() / ("rig-deskew-" + std::to_string(::getpid()))) {
    fs::remove_all(path);
    fs::create_directories(path);
  }
  ~Folder() { fs::remove_all(path); }
  [[nodiscard]] std::string file(const std::string& name) const { return (path / name).string(); }
  fs::path path;
};

constexpr const char* bench =
    R"({"schema": "bench/1", "lidar": {"mount": {"x_mm": 80, "y_mm": 20, "yaw_deg": 0}}})";

/// A session of a stage that turned at 40 deg/s, told by the capture's rate alone.
void write_turning(const std::string& file, int scans) {
  rig::SessionStore store(file, rig::SessionStore::Mode::create);
  store.set("bench", bench);
  fit::CaptureInfo info;
  info.step = "turn";
  info.started_us = 1'000'000;
  info.stage_rate_rad_s = 40 * room::deg;
  info.last_step = 1080;
  const auto id = store.begin_capture(info);
  std::mt19937 random(3);
  const auto walls = room::furnished();
  const auto lidar_at = [](double t) {
    const double a = 40 * room::deg * (t - 1);
    return room::Place{80 * std::cos(a) - 20 * std::sin(a), 80 * std::sin(a) + 20 * std::cos(a), a};
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

}  // namespace

TEST_CASE("rig deskew writes corrected points of every beam, poses, and pictures of the map") {
  const Folder folder;
  write_turning(folder.file("in.rig"), 80);
  rig::DeskewOptions options;
  options.offset_ms = 0;
  options.reversed = false;
  const std::string made = folder.file("out.rig");
  const auto result = rig::deskew_session(folder.file("in.rig"), made, options);
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
    const room::Place at{rows.getColumn(0).getDouble(), rows.getColumn(1).getDouble(),
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
  const Folder folder;
  {
    rig::SessionStore store(folder.file("empty.rig"), rig::SessionStore::Mode::create);
    store.set("bench", bench);
  }
  CHECK_THROWS_AS(rig::deskew_session(folder.file("empty.rig"), folder.file("out.rig"), {}),
                  rig::MeasurementError);
  CHECK_FALSE(fs::exists(folder.file("out.rig")));
  write_turning(folder.file("in.rig"), 6);
  write_turning(folder.file("there.rig"), 6);
  CHECK_THROWS_AS(rig::deskew_session(folder.file("in.rig"), folder.file("there.rig"), {}), rig::UsageError);
}
