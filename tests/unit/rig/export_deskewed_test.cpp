// SPDX-License-Identifier: MIT
// What rig deskew made, and what rig fit odometry found, on their way out.
#include <SQLiteCpp/SQLiteCpp.h>
#include <hdf5.h>
#include <yaml-cpp/yaml.h>

#include <catch2/catch.hpp>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "rig/errors.hpp"
#include "rig/export/exporter.hpp"
#include "rig/import/import_session.hpp"
#include "rig/import/mcap.hpp"
#include "tests/support/test_folder.hpp"

namespace export_deskewed_test {
namespace {

using Catch::Matchers::Contains;
using nlohmann::json;

constexpr int drive_scans = 3;

/// A robot that drives 100 mm a scan and turns left by 90 deg before the last; its lidar is 200 mm ahead.
std::string drive_session(const TestFolder& folder, bool deskewed) {
  const std::string path = folder / (deskewed ? "straight.rig" : "drive.rig");
  {
    rig::SessionStore store(path, rig::SessionStore::Mode::create);
    store.set("created_utc", "2026-01-02T03:04:05Z");
    store.set(
        "bench",
        R"({"schema": "bench/1", "lidar": {"scan_hz": 10, "mount": {"x_mm": {"value": 200, "u": 1}}}})");
    fit::CaptureInfo info;
    info.step = "drive";
    info.first_step = 540, info.last_step = 543;
    const auto capture = store.begin_capture(info);
    for (int i = 0; i < drive_scans; ++i) {
      const std::vector<std::uint16_t> range{1000, 0, 1200, 1300}, intensity{1, 2, 3, 4};
      fit::ScanView scan;
      scan.seq = i;
      scan.host_us = 100'000 * i;
      scan.range_mm = range, scan.intensity = intensity;
      store.add_scan(capture, scan);
      fit::TrackPose pose;
      pose.host_us = scan.host_us;
      pose.x_mm = 90.0 * i, pose.y_mm = 5, pose.heading_rad = i == 2 ? fit::pi / 2 : 0.0;
      pose.wheel_left_rad = 1.0 * i, pose.wheel_right_rad = 1.5 * i;
      store.add_pose(pose);
    }
    store.commit_capture(capture);
    store.finish();
  }
  if (!deskewed) return path;
  SQLite::Database database(path, SQLite::OPEN_READWRITE);
  database.exec(
      "CREATE TABLE deskewed(capture INTEGER, seq INTEGER, x_mm REAL, y_mm REAL, heading_deg REAL, points "
      "BLOB, "
      "PRIMARY KEY(capture, seq)) WITHOUT ROWID");
  for (int i = 0; i < drive_scans; ++i) {
    const bool turned = i == 2;
    const float nan = std::nanf("");
    const std::vector<float> points{1010.0F + static_cast<float>(i), 1, nan, nan, 1210, 2, 1310, 3};
    SQLite::Statement row(database, "INSERT INTO deskewed VALUES(1, ?, ?, ?, ?, ?)");
    row.bind(1, i);
    row.bind(2, turned ? 200.0 : 200.0 + 100 * i);  // the lidar: the robot is at 100 i
    row.bind(3, turned ? 200.0 : 0.0);
    row.bind(4, turned ? 90.0 : 0.0);
    row.bind(5, points.data(), static_cast<int>(points.size() * sizeof(float)));
    row.exec();
  }
  return path;
}

std::string export_as(const TestFolder& folder, const std::string& session_path, const std::string& format) {
  const std::string out = folder / ("out." + format);
  const rig::SessionStore session(session_path, rig::SessionStore::Mode::read);
  rig::run_export(format, {session_path, &session}, rig::check_output({out}));
  return out;
}

/// The messages of an exported sqlite3 bag, by topic, as an independent reader sees them.
std::map<std::string, std::vector<json>> messages_of(const TestFolder& folder, const std::string& bag) {
  const std::string command =
      "python3 " RIG_SOURCE_DIR "/tests/support/read_bag.py " + bag + " > " + (folder / "messages");
  REQUIRE(std::system(command.c_str()) == 0);
  std::map<std::string, std::vector<json>> out;
  std::ifstream in(folder / "messages");
  for (std::string line; std::getline(in, line);) {
    const json message = json::parse(line);
    out[message.at("topic")].push_back(message.at("message"));
  }
  return out;
}

const std::int64_t export_begin_ns = 1'767'323'045'000'000'000;  // 2026-01-02T03:04:05Z

std::string odometry_result(bool determined) {
  const json result = {{"schema", "result/1"},
                       {"kind", "odometry"},
                       {"values",
                        {{{"name", "left_radius_mm"}, {"value", 33.0}, {"u", 0.05}, {"unit", "mm"}},
                         {{"name", "right_radius_mm"}, {"value", 33.5}, {"u", 0.05}, {"unit", "mm"}},
                         {{"name", "separation_mm"},
                          {"value", determined ? json(170.25) : json()},
                          {"u", 0.5},
                          {"unit", "mm"}},
                         {{"name", "lidar_x_mm"}, {"value", -41.5}, {"u", 2}, {"unit", "mm"}},
                         {{"name", "lidar_y_mm"}, {"value", 2.5}, {"u", 2}, {"unit", "mm"}},
                         {{"name", "lidar_yaw_deg"}, {"value", 90}, {"u", 0.1}, {"unit", "deg"}}}},
                       {"undetermined", {"The wheel separation: the robot never turned."}}};
  return result.dump();
}

}  // namespace

TEST_CASE("a bag of a drive carries scans, wheels, odometry and the lidar's place") {
  const TestFolder folder;
  auto by_topic = messages_of(folder, export_as(folder, drive_session(folder, false), "db3"));
  CHECK(by_topic.count("/points") == 0);
  REQUIRE(by_topic["/odom"].size() == 3);
  const json& last = by_topic["/odom"][2];
  CHECK(last["stamp_ns"] == export_begin_ns + 200'000'000);
  CHECK(last["child"] == "base_link");
  CHECK(last["position"][0].get<double>() == Approx(0.18));
  CHECK(last["orientation"][3].get<double>() == Approx(std::sqrt(0.5)));
  CHECK(last["linear"][0].get<double>() == Approx(0.9));  // 90 mm in 0.1 s
  CHECK(last["angular"][2].get<double>() == Approx(fit::pi / 2 / 0.1));
  CHECK(by_topic["/tf"][1][0]["translation"][0].get<double>() == Approx(0.09));
  CHECK(by_topic["/tf_static"][0][0]["child"] == "laser");
  CHECK(by_topic["/tf_static"][0][0]["translation"][0].get<double>() == Approx(0.2));
  CHECK(by_topic["/scan"][0]["ranges"][0].get<double>() == Approx(1.0));
  bool wheels = false;
  for (const json& joints : by_topic["/joint_states"])
    wheels = wheels || joints["name"] == json({"left_wheel_joint", "right_wheel_joint"});
  CHECK(wheels);
}

TEST_CASE("a bag of a deskewed session carries the corrected points and the fused poses, in one clock") {
  const TestFolder folder;
  auto by_topic = messages_of(folder, export_as(folder, drive_session(folder, true), "db3"));
  REQUIRE(by_topic["/points"].size() == 3);
  const json& cloud = by_topic["/points"][1];
  CHECK(cloud["fields"] == json({"x", "y", "z", "intensity"}));
  CHECK(cloud["frame"] == "laser");
  REQUIRE(cloud["width"] == 3);  // without the beam that saw nothing
  CHECK(cloud["points"][0][0].get<double>() == Approx(1.011));
  CHECK(cloud["points"][1][1].get<double>() == Approx(0.002));
  CHECK(cloud["points"][2][3].get<double>() == 4);
  REQUIRE(by_topic["/tf"].size() == 3);
  for (int i = 0; i < 3; ++i) {
    const json& transform = by_topic["/tf"][static_cast<std::size_t>(i)][0];
    CHECK(transform["stamp_ns"] == by_topic["/points"][static_cast<std::size_t>(i)]["stamp_ns"]);
    // The robot, 200 mm behind its lidar: at 0, 100 and 200 mm, there turned to the left.
    CHECK(transform["translation"][0].get<double>() == Approx(0.1 * i).margin(1e-9));
    CHECK(transform["translation"][1].get<double>() == Approx(0).margin(1e-9));
  }
}

TEST_CASE("both kinds of ROS 2 bag hold the same messages, and rig reads its own back") {
  const TestFolder folder;
  const std::string session = drive_session(folder, true);
  const std::string db3 = export_as(folder, session, "db3"), mcap = export_as(folder, session, "mcap");
  std::multiset<std::string> in_mcap, in_db3;
  std::ifstream file(mcap, std::ios::binary);
  rig::read_mcap(file, [&](const rig::McapMessage& message) {
    in_mcap.insert(message.topic + " " + message.type + " " + std::to_string(message.log_time_ns) + " " +
                   std::string(message.data.begin(), message.data.end()));
    return true;
  });
  SQLite::Database bag(db3);
  SQLite::Statement row(
      bag, "SELECT name, type, timestamp, data FROM messages JOIN topics ON topics.id = topic_id");
  while (row.executeStep())
    in_db3.insert(row.getColumn(0).getString() + " " + row.getColumn(1).getString() + " " +
                  row.getColumn(2).getString() + " " + row.getColumn(3).getString());
  CHECK(in_mcap == in_db3);
  CHECK(in_db3.size() == 3 * 6 + 1);  // scan, stage, wheels, tf, odom, points; tf_static
  for (const std::string& from : {mcap, db3}) {
    rig::ImportRequest request;
    request.files = {from};
    request.output = rig::check_output({folder / (from == mcap ? "a.rig" : "b.rig")});
    rig::import_session(request);
    const rig::SessionStore store(request.output.path(), rig::SessionStore::Mode::read);
    CHECK(store.get("recorded_utc") == "2026-01-02T03:04:05Z");
    CHECK(json::parse(store.get("lidar_on_robot").value())["x_mm"].get<double>() == Approx(200));
    double farthest = 0, wheel = 0;
    for (const auto& at : store.recording()->track()) {
      farthest = std::max(farthest, at.x_mm.value_or(0));
      wheel = std::max(wheel, at.wheel_right_rad.value_or(0));
    }
    CHECK(farthest == Approx(200));
    CHECK(wheel == 3);
  }
}

TEST_CASE("CSV gives the corrected points beside what was measured, and the track as a table of its own") {
  const TestFolder folder;
  const std::string session = drive_session(folder, true);
  std::istringstream lines(file_text(export_as(folder, session, "csv")));
  std::vector<std::string> rows;
  for (std::string line; std::getline(lines, line);) rows.push_back(line);
  REQUIRE(rows.size() == 1 + 3 * 4);
  CHECK_THAT(rows[0], Catch::EndsWith(",range_mm,intensity,deskewed_x_mm,deskewed_y_mm,map_x_mm,map_y_mm"));
  CHECK_THAT(rows[2], Catch::EndsWith(",0,2,,,,"));
  // Turned by 90 deg at (200, 200): (1012, 1) lies at (199, 1212).
  CHECK_THAT(rows[9], Catch::EndsWith(",1000,1,1012.00,1.00,199.00,1212.00"));
  CHECK_THAT(file_text(export_as(folder, session, "csv-poses")), Contains("\n100000,90,5,0,1,1.5,\n"));
  CHECK_THAT(file_text(export_as(folder, drive_session(folder, false), "csv")),
             Contains(",range_mm,intensity\n") && !Contains("deskewed"));
}

TEST_CASE("HDF5 holds the corrected points and poses, and the track") {
  const TestFolder folder;
  const hid_t file =
      H5Fopen(export_as(folder, drive_session(folder, true), "hdf5").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  REQUIRE(file >= 0);
  const auto read = [&](const char* name, std::size_t count) {
    std::vector<double> values(count);
    const hid_t data = H5Dopen2(file, name, H5P_DEFAULT);
    REQUIRE(data >= 0);
    CHECK(H5Dread(data, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) >= 0);
    H5Dclose(data);
    return values;
  };
  const auto x = read("/captures/1/deskewed_x_mm", 12), pose = read("/captures/1/deskewed_pose", 9);
  CHECK(x[8] == 1012);
  CHECK(std::isnan(x[1]));
  CHECK(pose[7] == 200);
  CHECK(pose[8] == Approx(90));
  CHECK(read("/track/wheels_rad", 6)[5] == 3);
  CHECK(read("/track/pose", 9)[8] == Approx(90));
  H5Fclose(file);
}

TEST_CASE("odometry's result leaves as URDF, as parameters of diff_drive_controller and as JSON") {
  const TestFolder folder;
  std::ofstream(folder / "result.json") << odometry_result(true);
  const auto text_as = [&](const std::string& format) {
    rig::run_export(format, {folder / "result.json"}, rig::check_output({folder / format}));
    return file_text(folder / format);
  };
  const YAML::Node parameters =
      YAML::Load(text_as("diff-drive-controller"))["diff_drive_controller"]["ros__parameters"];
  const double radius_m = parameters["wheel_radius"].as<double>();
  CHECK(radius_m * parameters["left_wheel_radius_multiplier"].as<double>() == Approx(0.033));
  CHECK(radius_m * parameters["right_wheel_radius_multiplier"].as<double>() == Approx(0.0335));
  CHECK(parameters["wheel_separation"].as<double>() == Approx(0.17025));
  const std::string urdf = text_as("urdf");
  CHECK_THAT(urdf, Contains("<origin xyz=\"-0.0415 0.0025 0\" rpy=\"0 0 1.570796\"/>") &&
                       Contains("<origin xyz=\"0 0.085125 0\"") && Contains("cylinder radius=\"0.0335\""));
  std::ofstream(folder / "parse.py")
      << "import sys, xml.etree.ElementTree as t; r = t.parse(sys.argv[1]).getroot(); "
         "assert r.tag == 'robot' and len(r.findall('joint')) == 3, r";
  CHECK(std::system(("python3 " + (folder / "parse.py") + " " + (folder / "urdf")).c_str()) == 0);
  const json document = json::parse(text_as("odometry"));
  CHECK(document.at("schema") == "odometry/1");
  CHECK(document.at("values").at("lidar_yaw_deg").at("value") == 90);
}

TEST_CASE("an odometry's result that leaves a value open, or none at all, is refused with the reason") {
  const TestFolder folder;
  std::ofstream(folder / "open.json") << odometry_result(false);
  CHECK_THROWS_WITH(rig::run_export("urdf", {folder / "open.json"}, rig::check_output({folder / "x"})),
                    Contains("separation_mm") && Contains("never turned"));
  std::ofstream(folder / "other.json") << "{}";
  CHECK_THROWS_WITH(rig::run_export("odometry", {folder / "other.json"}, rig::check_output({folder / "x"})),
                    Contains("not a result of 'rig fit odometry'"));
  const std::string session = drive_session(folder, false);
  CHECK_THROWS_WITH(export_as(folder, session, "diff-drive-controller"), Contains("run 'rig fit odometry"));
}

}  // namespace export_deskewed_test
