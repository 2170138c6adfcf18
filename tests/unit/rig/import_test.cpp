// SPDX-License-Identifier: MIT
#include <SQLiteCpp/SQLiteCpp.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "rig/errors.hpp"
#include "rig/export/exporter.hpp"
#include "rig/import/cdr.hpp"
#include "rig/import/import_session.hpp"
#include "rig/session/session_store.hpp"
#include "rig/text_lines.hpp"
#include "tests/support/bags.hpp"
#include "tests/support/test_folder.hpp"

namespace import_test {
namespace {

namespace fs = std::filesystem;
using Catch::Matchers::Contains;

constexpr std::int64_t t0 = 1'770'000'000'000'000'000;

std::vector<bags::Message> robot_messages() {
  return {
      {"/tf_static", "tf2_msgs/msg/TFMessage", t0, bags::lidar_place(-0.032, 0.1)},
      {"/scan", "sensor_msgs/msg/LaserScan", t0,
       bags::laser_scan(t0, {0.5004f, 1.0006f, 0.0f, INFINITY, NAN}, {230, 231.6f, 0, 0, NAN})},
      {"/odom", "nav_msgs/msg/Odometry", t0, bags::odometry(t0 + 50'000'000, 1.5, -0.25, 3.0)},
      {"/joint_states", "sensor_msgs/msg/JointState", t0, bags::joint_state(t0 + 60'000'000, 7.5, 8.5)},
      {"/imu", "sensor_msgs/msg/Imu", t0, bags::imu(t0 + 70'000'000, -1.0, 0.25)},
      {"/scan", "sensor_msgs/msg/LaserScan", t0,
       bags::laser_scan(t0 + 110'000'000, {70.0f, 2.0f, 3.0f}, {}, -0.25f, 0.125f)},
      {"/scan_back", "sensor_msgs/msg/LaserScan", t0, bags::laser_scan(t0, {4.0f}, {})},
  };
}

bags::Bytes robot_mcap(const std::string& compression) {
  bags::McapWriter writer(compression, 2);
  for (const auto& message : robot_messages()) writer.add(message);
  return writer.finish();
}

std::string make_db3(const TestFolder& folder, const std::string& name, bool packed) {
  const std::string path = folder / name;
  SQLite::Database bag(path, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
  bag.exec(
      "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
      "serialization_format"
      " TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)");
  bag.exec(
      "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, "
      "data"
      " BLOB NOT NULL)");
  std::map<std::string, int> ids;
  for (const auto& message : robot_messages()) {
    const auto [id, added] = ids.emplace(message.topic, static_cast<int>(ids.size()) + 1);
    if (added) {
      SQLite::Statement topic(bag, "INSERT INTO topics VALUES(?, ?, ?, 'cdr', '')");
      topic.bind(1, id->second);
      topic.bind(2, message.topic);
      topic.bind(3, message.type);
      topic.exec();
    }
    bags::Bytes data = message.data;
    if (packed) {
      data.resize(ZSTD_compressBound(data.size()));
      data.resize(ZSTD_compress(data.data(), data.size(), message.data.data(), message.data.size(), 3));
    }
    SQLite::Statement row(bag, "INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)");
    row.bind(1, id->second);
    row.bind(2, message.log_ns);
    row.bind(3, data.data(), static_cast<int>(data.size()));
    row.exec();
  }
  return path;
}

rig::ImportRequest request(const std::vector<std::string>& files, const std::string& output) {
  rig::ImportRequest result;
  result.files = files;
  result.output = rig::check_output({output});
  return result;
}

std::string all(const std::vector<std::string>& notes) {
  std::string text;
  for (const auto& note : notes) text += note + "\n";
  return text;
}

/// What every way of storing robot_messages() must give.
void check_robot_session(const std::string& path) {
  const rig::SessionStore store(path, rig::SessionStore::Mode::read);
  const auto recording = store.recording();
  REQUIRE(recording->captures().size() == 1);
  CHECK(store.get("recorded_utc") == "2026-02-02T02:40:00Z");  // t0
  CHECK(store.get("lidar") == "{}");                           // A topic's frame is no model.
  std::vector<std::vector<std::uint16_t>> ranges, intensities;
  std::vector<std::int64_t> times;
  std::vector<fit::ScanGeometry> geometries;
  recording->for_each_scan(0, [&](const fit::ScanView& scan) {
    ranges.emplace_back(scan.range_mm.begin(), scan.range_mm.end());
    intensities.emplace_back(scan.intensity.begin(), scan.intensity.end());
    times.push_back(scan.host_us);
    geometries.push_back(scan.geometry.value());
  });
  REQUIRE(ranges.size() == 2);
  CHECK(ranges[0] == std::vector<std::uint16_t>{500, 1001, 0, 0, 0});
  CHECK(intensities[0] == std::vector<std::uint16_t>{230, 232, 0, 0, 0});
  CHECK(ranges[1] == std::vector<std::uint16_t>{0, 2000, 3000});
  CHECK(intensities[1].empty());
  CHECK(times == std::vector<std::int64_t>{0, 110'000});
  CHECK(geometries[0].first_rad == Approx(-0.5));
  CHECK(geometries[1].step_rad == Approx(0.125));
  CHECK(geometries[1].scan_s.value() == Approx(0.003));
  const auto& track = recording->track();
  REQUIRE(track.size() == 2);
  CHECK(track[0].host_us == 50'000);
  CHECK(track[0].x_mm.value() == Approx(1500));
  CHECK(track[0].heading_rad.value() == Approx(3.0));
  CHECK(track[1].wheel_left_rad.value() == 7.5);
  CHECK(track[1].wheel_right_rad.value() == 8.5);
  const auto place = nlohmann::json::parse(store.get("lidar_on_robot").value());
  CHECK(place["x_mm"].get<double>() == Approx(-32));
  CHECK(place["yaw_deg"].get<double>() == Approx(5.729578));
  CHECK(recording->bench().lidar.mount.x_mm.value == Approx(-32));
  SQLite::Database database(path);
  CHECK(database.execAndGet("SELECT yaw_deg FROM imu").getDouble() == Approx(-57.29578));
}

}  // namespace

TEST_CASE("a robot's MCAP bag becomes a session, whatever its compression") {
  const TestFolder folder;
  for (const std::string compression : {"", "lz4", "zstd"}) {
    INFO("compression '" << compression << "'");
    const auto bag = folder.write("bag.mcap", robot_mcap(compression));
    fs::remove(folder / "out.rig");
    const auto report = rig::import_session(request({bag}, folder / "out.rig"));
    CHECK(report.scans == 2);
    CHECK(report.poses == 2);
    CHECK_THAT(all(report.notes), Contains("/scan_back was left out") && Contains("65.5 m"));
    check_robot_session(folder / "out.rig");
  }
}

TEST_CASE("a sqlite3 bag becomes the same session, with plain and with compressed messages") {
  const TestFolder folder;
  for (const bool packed : {false, true}) {
    fs::remove(folder / "bag.db3");
    fs::remove(folder / "out.rig");
    const auto bag = make_db3(folder, "bag.db3", packed);
    rig::import_session(request({bag}, folder / "out.rig"));
    check_robot_session(folder / "out.rig");
  }
}

TEST_CASE("a bag folder is read in the order of its metadata, and without metadata by name") {
  const TestFolder folder;
  fs::create_directories(folder / "bag");
  folder.write("bag/bag_0.mcap", robot_mcap("zstd"));
  rig::import_session(request({folder / "bag/"}, folder / "named.rig"));
  check_robot_session(folder / "named.rig");
  folder.write("bag/metadata.yaml",
               "rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:\n    - bag_0.mcap\n");
  rig::import_session(request({folder / "bag"}, folder / "listed.rig"));
  check_robot_session(folder / "listed.rig");
}

TEST_CASE("a bag folder's metadata names nothing but bag files in the folder") {
  const TestFolder folder;
  fs::create_directories(folder / "bag/inner.mcap");
  folder.write("bag/bag_0.mcap", robot_mcap("zstd"));
  folder.write("outside.mcap", robot_mcap(""));
  folder.write("bag/metadata.yaml",
               "rosbag2_bagfile_information:\n  relative_file_paths: ['', '.', '..', 'bag/', './', "
               "inner.mcap, metadata.yaml, '../outside.mcap', bag_0.mcap]\n");
  const auto report = rig::import_session(request({folder / "bag"}, folder / "out.rig"));
  check_robot_session(folder / "out.rig");
  for (const char* named : {"''", "'.'", "'..'", "'bag/'", "'inner.mcap'", "'../outside.mcap'"})
    CHECK_THAT(all(report.notes), Contains(std::string(named) + ", which is no bag file in the folder"));
}

TEST_CASE("a range is a range, whoever wrote it down") {
  const auto in_bag = [](float range_m, float level) {
    return std::pair(rig::range_of(range_m * 1000.0), rig::intensity_of(level));
  };
  CHECK(in_bag(4.0F, 100.4F) == std::pair<std::uint16_t, std::uint16_t>(4000, 100));
  CHECK(in_bag(65.4994F, 1e9F) == std::pair<std::uint16_t, std::uint16_t>(65499, 65535));
  for (const float none : {0.0F, 0.019F, 65.4996F, 65.533F, 1e30F, -1.0F, NAN, INFINITY})
    CHECK(in_bag(none, NAN) == std::pair<std::uint16_t, std::uint16_t>(0, 0));
  const TestFolder folder;
  bags::McapWriter bag;
  for (int i = 0; i < 3; ++i)
    bag.add({"/scan", "sensor_msgs/msg/LaserScan", t0 + 25'000'000 * i,
             bags::laser_scan(t0 + 25'000'000 * i, {0.005F, 1, 65.533F, 2}, {NAN, 1, 2, 3})});
  rig::import_session(request({folder.write("codes.mcap", bag.finish())}, folder / "out.rig"));
  const rig::SessionStore session(folder / "out.rig", rig::SessionStore::Mode::read);
  session.recording()->for_each_scan(0, [](const fit::ScanView& scan) {
    CHECK(std::vector<std::uint16_t>(scan.range_mm.begin(), scan.range_mm.end()) ==
          std::vector<std::uint16_t>{0, 1000, 0, 2000});
    CHECK(scan.intensity[0] == 0);
  });
}

TEST_CASE("a bag that is imported and exported again has the times of the lidar") {
  const TestFolder folder;
  bags::McapWriter bag;
  for (int i = 0; i < 3; ++i)
    bag.add({"/scan", "sensor_msgs/msg/LaserScan", t0 + 25'000'000 * i,
             bags::laser_scan(t0 + 25'000'000 * i, {1, 1, 1, 1}, {})});
  rig::import_session(request({folder.write("first.mcap", bag.finish())}, folder / "out.rig"));
  const rig::SessionStore session(folder / "out.rig", rig::SessionStore::Mode::read);
  const std::string again = folder / "again.mcap";
  rig::run_export("mcap", {folder / "out.rig", &session}, rig::check_output({again}));
  std::ifstream file(again, std::ios::binary);
  int scans = 0;
  rig::read_mcap(file, [&](const rig::McapMessage& message) {
    if (message.type != "sensor_msgs/msg/LaserScan") return true;
    ++scans;
    rig::CdrReader in(message.data);
    in.skip<std::uint32_t>(2);
    (void)in.text();
    in.skip<float>(3);
    CHECK(in.value<float>() == Approx(0.001));                       // from beam to beam
    CHECK(in.value<float>() == Approx(0.001 * 2 * fit::pi / 0.25));  // of a turn
    CHECK(in.value<float>() == Approx(0.02));
    CHECK(in.value<float>() == Approx(65.5));
    return true;
  });
  CHECK(scans == 3);
}

TEST_CASE("a bag file that was packed whole is unpacked on the way") {
  const TestFolder folder;
  const auto plain = robot_mcap("");
  bags::Bytes packed(ZSTD_compressBound(plain.size()));
  packed.resize(ZSTD_compress(packed.data(), packed.size(), plain.data(), plain.size(), 3));
  const auto bag = folder.write("bag_0.mcap.zstd", packed);
  rig::import_session(request({bag}, folder / "out.rig"));
  check_robot_session(folder / "out.rig");
}

TEST_CASE("a bag cut at any place never fails worse than with a message, and keeps what is whole") {
  for (const std::string compression : {"", "lz4", "zstd"}) {
    const auto whole = robot_mcap(compression);
    std::uint64_t most = 0;
    for (std::size_t cut = 8; cut < whole.size(); ++cut) {
      std::istringstream in(std::string(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(cut)));
      const auto summary = rig::read_mcap(in, [](const rig::McapMessage&) { return true; });
      CHECK(summary.messages >= most);
      most = std::max(most, summary.messages);
    }
    CHECK(most == robot_messages().size());
  }
}

TEST_CASE("a truncated bag says so and keeps the scans before the cut") {
  const TestFolder folder;
  auto bytes = robot_mcap("");
  bytes.resize(bytes.size() / 2);
  const auto report = rig::import_session(request({folder.write("cut.mcap", bytes)}, folder / "out.rig"));
  CHECK(report.scans == 1);
  CHECK_THAT(all(report.notes), Contains("cut off"));
}

TEST_CASE("a damaged chunk costs that chunk, not the file") {
  const auto whole = robot_mcap("");
  auto bytes = whole;
  // The last byte of the first chunk's records: its messages are then doubtful, the next chunks are not.
  const std::string magic = "base_scan";
  const auto place = std::search(bytes.begin(), bytes.end(), magic.begin(), magic.end());
  *place ^= 1;
  std::istringstream in(std::string(bytes.begin(), bytes.end()));
  const auto summary = rig::read_mcap(in, [](const rig::McapMessage&) { return true; });
  CHECK(summary.bad_chunks == 1);
  CHECK_THAT(all(summary.notes), Contains("checksum is wrong"));
  CHECK(summary.messages > 0);
  CHECK(summary.messages < robot_messages().size());
}

TEST_CASE("a length that lies costs no memory") {
  bags::Bytes bytes{0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n', 6};
  for (const std::uint8_t byte : {0xff, 0xff, 0xff, 0x1f, 0, 0, 0, 0}) bytes.push_back(byte);
  std::istringstream in(std::string(bytes.begin(), bytes.end()));
  CHECK(rig::read_mcap(in, [](const rig::McapMessage&) { return true; }).truncated);
}

TEST_CASE("a message whose array claims more than it holds is refused, not allocated") {
  auto scan = bags::laser_scan(t0, {1.0f, 2.0f}, {});
  const bags::Bytes two{2, 0, 0, 0, 0, 0, 0x80, 0x3f};  // the length before 1.0f
  auto length = std::search(scan.begin(), scan.end(), two.begin(), two.end());
  REQUIRE(length != scan.end());
  length[3] = 0x7f;
  rig::CdrReader in(scan);
  in.skip<std::uint32_t>(2);
  CHECK(in.text() == "base_scan");
  in.skip<float>(7);
  CHECK_THROWS_AS(in.sequence<float>(), rig::CdrError);
}

TEST_CASE("big-endian messages are understood") {
  const bags::Bytes bytes{0, 0, 0, 0, 0, 0, 1,    2,    0, 0, 0, 3, 'a', 'b',
                          0, 0, 0, 0, 0, 1, 0x3f, 0xf8, 0, 0, 0, 0, 0,   0};
  rig::CdrReader in(bytes);
  CHECK(in.value<std::int32_t>() == 258);
  CHECK(in.text() == "ab");
  CHECK(in.sequence<double>() == std::vector<double>{1.5});
}

TEST_CASE("recordings that hold nothing are refused with the reason, and leave no session behind") {
  const TestFolder folder;
  const auto try_import = [&](const std::string& file) {
    rig::import_session(request({file}, folder / "out.rig"));
  };
  CHECK_THROWS_WITH(try_import(folder.write("empty.mcap", std::string())), Contains("is empty"));
  CHECK_THROWS_WITH(try_import(folder.write("none.mcap", bags::McapWriter().finish())),
                    Contains("no messages"));
  CHECK_THROWS_WITH(try_import(folder.write("text.mcap", std::string("hello"))),
                    Contains("not an MCAP file"));
  CHECK_THROWS_WITH(try_import(folder.write("what.xyz", std::string("hello"))), Contains("It reads"));
  CHECK_THROWS_WITH(try_import(folder / "missing.mcap"), Contains("no such file"));
  CHECK_THROWS_WITH(try_import(folder.write("broken.db3", std::string("SQLite format 3\0garbage", 23))),
                    Contains("cannot be read as a ROS 2 bag"));
  bags::McapWriter writer;
  writer.add({"/odom", "nav_msgs/msg/Odometry", t0, bags::odometry(t0, 1, 2, 3)});
  CHECK_THROWS_WITH(try_import(folder.write("odom.mcap", writer.finish())),
                    Contains("no sensor_msgs/LaserScan") && Contains("nav_msgs/Odometry"));
  CHECK_FALSE(fs::exists(folder / "out.rig"));
}

TEST_CASE("distances are found in file and folder names") {
  CHECK(rig::distance_in_name("/data/lidar_calibration_0.5m/_0.mcap") == 500.0);
  CHECK(rig::distance_in_name("lidar_calibration_1.5m/") == 1500.0);
  CHECK(rig::distance_in_name("wall_1500mm_0.mcap") == 1500.0);
  CHECK(rig::distance_in_name("20 cm.db3") == 200.0);
  CHECK_FALSE(rig::distance_in_name("/data/eyqW7m/new.log"));  // a word of its own
  CHECK_FALSE(rig::distance_in_name("run_3_morning.mcap"));
  CHECK_FALSE(rig::distance_in_name("bag_0.mcap"));
}

TEST_CASE("true distances put a target and its shifts into the session") {
  const TestFolder folder;
  const auto a = folder.write("a.mcap", robot_mcap("")), b = folder.write("b.mcap", robot_mcap("lz4"));
  auto asked = request({a, b}, folder / "out.rig");
  asked.true_mm = {2000, 2750};
  asked.true_u_mm = 2;
  rig::import_session(asked);
  const rig::SessionStore store(folder / "out.rig", rig::SessionStore::Mode::read);
  const auto recording = store.recording();
  REQUIRE(recording->captures().size() == 2);
  CHECK(recording->captures()[0].target_shift_mm == 0);
  CHECK(recording->captures()[1].target_shift_mm == 750);
  CHECK(recording->captures()[1].target.value() == "wall");
  const auto* wall = recording->bench().target("wall");
  REQUIRE(wall != nullptr);
  CHECK(wall->from_mm.x() == 2000);
  CHECK(wall->u_mm == 2);
  asked.true_mm = {500};
  asked.output = rig::check_output({folder / "other.rig"});
  CHECK_THROWS_AS(rig::import_session(asked), rig::UsageError);
}

TEST_CASE("a CARMEN log becomes a session with odometry and the lidar's place") {
  const TestFolder folder;
  const auto log =
      folder.write("run.log", std::string("# CARMEN Logfile\n"
                                          "ODOM 1 2 0.5 0 0 0 100.0 host 0.0\n"
                                          "FLASER 3 1.0 2.5 81.91 1.1 2 0.5 1.0 2 0.5 100.5 host 0.5\n"
                                          "ROBOTLASER1 0 -0.5 1 0.5 30 0.01 0 3 1.5 2.5 30 0 1 2 0 1 2 0 0 "
                                          "0 0 0 0 101 host 1.0\n"
                                          "FLASER 5 1.0 2.0\n"));
  const auto report = rig::import_session(request({log}, folder / "out.rig"));
  CHECK(report.scans == 2);
  CHECK_THAT(all(report.notes), Contains("1 lines were truncated"));
  const rig::SessionStore store(folder / "out.rig", rig::SessionStore::Mode::read);
  const auto recording = store.recording();
  std::vector<std::uint16_t> first;
  recording->for_each_scan(0, [&](const fit::ScanView& scan) {
    if (scan.seq == 0) {
      first.assign(scan.range_mm.begin(), scan.range_mm.end());
      CHECK(scan.geometry->first_rad == Approx(-fit::pi / 2));
      CHECK(scan.geometry->step_rad == Approx(fit::pi / 2));
    } else {
      CHECK(scan.host_us == 500'000);
      CHECK(scan.range_mm[2] == 0);
    }
  });
  CHECK(first == std::vector<std::uint16_t>{1000, 2500, 0});
  CHECK(recording->track().size() == 3);
  CHECK(recording->bench().lidar.mount.x_mm.value == Approx(100 * std::cos(0.5)).margin(0.01));
}

TEST_CASE("the public recordings of a wall and of a drive are read whole") {
  const fs::path real = fs::path(RIG_SOURCE_DIR) / "../shared/real";
  if (!fs::exists(real / "lds02-wall")) {
    WARN("skipped: the public recordings are not beside the project (../shared/real)");
    return;
  }
  const TestFolder folder;
  const auto wall = (real / "lds02-wall/lidar_calibration_").string();
  const auto report = rig::import_session(
      request({wall + "0.5m", wall + "1m", wall + "1.5m", wall + "2m"}, folder / "wall.rig"));
  CHECK(report.scans == 289 + 303 + 286 + 311);
  CHECK_THAT(all(report.notes), Contains("500, 1000, 1500, 2000 mm"));
  const auto drive =
      rig::import_session(request({(real / "turtlebot3-drive/drive.mcap").string()}, folder / "drive.rig"));
  CHECK(drive.scans == 549);
  CHECK(drive.poses == 1256 + 1254);
  SQLite::Database database(folder / "drive.rig");
  CHECK(database.execAndGet("SELECT count(*) FROM imu").getInt() == 1256);
  const rig::SessionStore store(folder / "drive.rig", rig::SessionStore::Mode::read);
  CHECK(nlohmann::json::parse(store.get("lidar_on_robot").value())["x_mm"].get<double>() == Approx(-32));
}

TEST_CASE("seeds of the fuzz corpora are written", "[.corpus]") {
  const fs::path corpus = fs::path(RIG_SOURCE_DIR) / "tests/fuzz/corpus";
  const auto write = [&](const std::string& name, const bags::Bytes& bytes) {
    std::ofstream(corpus / name, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  };
  for (const char* compression : {"", "lz4", "zstd"})
    write(std::string("mcap/robot-") + (*compression ? compression : "none"), robot_mcap(compression));
  const std::vector<std::string> types{"LaserScan", "Odometry", "JointState", "Imu", "TFMessage"};
  for (const auto& message : robot_messages()) {
    const std::string type = message.type.substr(message.type.rfind('/') + 1);
    bags::Bytes bytes = message.data;
    bytes.insert(bytes.begin(), static_cast<std::uint8_t>(std::ranges::find(types, type) - types.begin()));
    write("cdr/" + type, bytes);
  }
}

}  // namespace import_test
