// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "rig/fitting/fitting.hpp"
#include "rig/import/import_session.hpp"
#include "rig/session/session_store.hpp"
#include "tests/support/test_folder.hpp"

namespace recorded_drive_test {

namespace fs = std::filesystem;

TEST_CASE("the public recording of a drive calibrates wheels and lidar, as its gyroscope confirms") {
  const fs::path bag = fs::path(RIG_SOURCE_DIR) / "../shared/real/turtlebot3-drive/drive.mcap";
  if (!fs::exists(bag)) {
    WARN("skipped: the public recordings are not beside the project");
    return;
  }
  const TestFolder folder;
  const std::string file = folder / "drive.rig";
  rig::ImportRequest request;
  request.files = {bag.string()};
  request.output = rig::check_output({file});
  rig::import_session(request);
  const rig::SessionStore session(file, rig::SessionStore::Mode::read);
  const auto result = rig::run_fit("odometry", {{file, &session}}, nlohmann::json::object());
  const auto value = [&](const std::string& name, const char* field) {
    for (const auto& entry : result.at("values"))
      if (entry.at("name") == name) return entry.at(field).get<double>();
    return std::nan("");
  };
  CHECK(result.at("undetermined").empty());
  // Nominal: 33, 160, (-32, 0) mm, 0 deg. The gyroscope's turn for each radian of wheel difference: 0.1855.
  const double radius = 0.5 * (value("left_radius_mm", "value") + value("right_radius_mm", "value"));
  CHECK(radius == Approx(33).margin(1.2));
  CHECK(radius / value("separation_mm", "value") == Approx(0.1855).margin(0.005));
  CHECK(value("lidar_x_mm", "value") == Approx(-32).margin(20));
  CHECK(value("lidar_y_mm", "value") == Approx(0).margin(12));
  CHECK(value("lidar_yaw_deg", "value") == Approx(0).margin(1.5));
  CHECK(value("left_radius_mm", "u") < 0.5);
  CHECK(value("separation_mm", "u") < 5);
}

}  // namespace recorded_drive_test
