// SPDX-License-Identifier: MIT
// Recordings that an independent writer made (tests/support/foreign_recordings.py).
#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>

#include "rig/errors.hpp"
#include "rig/import/import_session.hpp"
#include "rig/import/ros1_bag.hpp"
#include "rig/session/session_store.hpp"
#include "tests/support/foreign_recordings.hpp"

namespace import_foreign_test {
namespace {

namespace fs = std::filesystem;
using Catch::Matchers::Contains;
using nlohmann::json;

const ForeignRecordings& recordings() {
  static const ForeignRecordings all;
  return all;
}

struct ForeignImport {
  std::string notes;
  std::vector<std::vector<std::uint16_t>> range_mm, intensity;
  std::vector<std::int64_t> time_us;
  std::vector<fit::ScanGeometry> geometry;
  std::vector<fit::TrackPose> track;
  fit::Bench bench;
  json lidar_on_robot;
  double imu_deg = NAN;
};

ForeignImport import_foreign(const std::vector<std::string>& files, const rig::ImportOptions& options = {},
                             bool accept_doubts = false, std::vector<double> true_mm = {}) {
  const TestFolder folder;
  rig::ImportRequest request;
  request.files = files;
  request.output = rig::check_output({folder / "out.rig"});
  request.options = options;
  request.accept_doubts = accept_doubts;
  request.true_mm = std::move(true_mm);
  ForeignImport out;
  for (const auto& note : rig::import_session(request).notes) out.notes += note + "\n";
  const rig::SessionStore store(request.output.path(), rig::SessionStore::Mode::read);
  const auto recording = store.recording();
  for (std::size_t i = 0; i < recording->captures().size(); ++i)
    recording->for_each_scan(i, [&](const fit::ScanView& scan) {
      out.range_mm.emplace_back(scan.range_mm.begin(), scan.range_mm.end());
      out.intensity.emplace_back(scan.intensity.begin(), scan.intensity.end());
      out.time_us.push_back(scan.host_us);
      out.geometry.push_back(scan.geometry.value_or(fit::ScanGeometry{}));
    });
  out.track = recording->track();
  out.bench = recording->bench();
  out.lidar_on_robot = json::parse(store.get("lidar_on_robot").value_or("null"));
  return out;
}

ForeignImport import_named(const std::string& name, const rig::ImportOptions& options = {}) {
  return import_foreign({recordings().file(name)}, options);
}

/// Whether every scan is the one that was written: ranges within the millimetre that text may round, the
/// beams' directions, the times.
void check_scans(const ForeignImport& in, bool with_intensity, bool with_times = true) {
  const json& expected = recordings().expected;
  REQUIRE(in.range_mm.size() == expected["range_mm"].size());
  for (std::size_t i = 0; i < in.range_mm.size(); ++i) {
    INFO("scan " << i);
    std::vector<std::uint16_t> wanted = expected["range_mm"][i];
    // A point cloud does not tell the beams that saw nothing at its ends.
    const double first_deg = expected["first_deg"], step_deg = expected["step_deg"];
    const auto missing = static_cast<std::size_t>(
        std::lround((in.geometry[i].first_rad * fit::deg_per_rad - first_deg) / step_deg));
    wanted.erase(wanted.begin(), wanted.begin() + static_cast<std::ptrdiff_t>(missing));
    while (wanted.size() > in.range_mm[i].size() && wanted.back() == 0) wanted.pop_back();
    REQUIRE(in.range_mm[i] == wanted);
    CHECK(in.geometry[i].first_rad * fit::deg_per_rad ==
          Approx(first_deg + static_cast<double>(missing) * step_deg).margin(0.01));
    CHECK(in.geometry[i].step_rad * fit::deg_per_rad == Approx(step_deg).margin(0.001));
    if (with_times) CHECK(in.time_us[i] == expected["time_us"][i]);
    if (!with_intensity) continue;
    REQUIRE(in.intensity[i].size() == in.range_mm[i].size());
    CHECK(in.intensity[i][3] == 103 + missing);
  }
}

void check_odometry(const std::vector<fit::TrackPose>& track) {
  const json& expected = recordings().expected;
  std::size_t checked = 0;
  for (const auto& at : track) {
    if (!at.x_mm) continue;
    const auto i = static_cast<std::size_t>(std::lround(at.host_us / 1e5));
    REQUIRE(i < expected["pose"].size());
    CHECK(*at.x_mm == Approx(1000 * expected["pose"][i][0].get<double>()).margin(0.01));
    CHECK(*at.y_mm == Approx(1000 * expected["pose"][i][1].get<double>()).margin(0.01));
    CHECK(*at.heading_rad == Approx(expected["pose"][i][2].get<double>()).margin(1e-5));
    ++checked;
  }
  CHECK(checked >= 18);
}

void check_wheels(const std::vector<fit::TrackPose>& track, double margin_rad) {
  const json& expected = recordings().expected;
  std::size_t i = 0;
  double left_rad = 0, right_rad = 0;  // Counters may begin anywhere.
  for (const auto& at : track) {
    if (!at.wheel_left_rad) continue;
    REQUIRE(i < expected["wheels_rad"].size());
    if (i == 0) left_rad = *at.wheel_left_rad, right_rad = *at.wheel_right_rad;
    CHECK(*at.wheel_left_rad - left_rad ==
          Approx(expected["wheels_rad"][i][0].get<double>()).margin(margin_rad));
    CHECK(*at.wheel_right_rad - right_rad ==
          Approx(expected["wheels_rad"][i][1].get<double>()).margin(margin_rad));
    ++i;
  }
  CHECK(i == expected["wheels_rad"].size());
}

/// By which rounding to whole ticks changes an angle, twice: where it began, and where it is.
double half_tick() { return 2 * 1.01 * fit::pi / recordings().expected["ticks_a_turn"].get<double>(); }

rig::ImportOptions with_columns(std::vector<std::string> columns) {
  rig::ImportOptions options;
  options.columns = std::move(columns);
  return options;
}

}  // namespace

TEST_CASE("a ROS 1 bag gives scans, odometry, wheels and the lidar's place, whatever its compression") {
  for (const std::string compression : {"none", "bz2", "lz4"}) {
    INFO(compression);
    const auto in = import_named("robot-" + compression + ".bag");
    check_scans(in, true);
    check_odometry(in.track);
    check_wheels(in.track, 1e-9);
    CHECK(in.geometry[0].scan_s.value() == Approx(0.1 * 37 * 5 / 360));
    // The build of the robot comes with the moving transforms, as ROS 1 publishes it.
    CHECK(in.lidar_on_robot["parent"] == "base_link");
    CHECK(in.lidar_on_robot["x_mm"].get<double>() == Approx(120));
    CHECK(in.lidar_on_robot["yaw_deg"].get<double>() == Approx(90));
    CHECK(in.notes.empty());
  }
}

TEST_CASE("a bag that has transforms alone gives its odometry by them, and says so") {
  const auto in = import_named("tf-only.bag");
  check_scans(in, true);
  check_odometry(in.track);
  CHECK_THAT(in.notes, Contains("no nav_msgs/Odometry") && Contains("odom to base_link"));
}

TEST_CASE("a ROS 1 bag that is cut gives every whole message before the cut, wherever the cut is") {
  for (const std::string compression : {"none", "bz2", "lz4"}) {
    const std::string whole = file_text(recordings().file("robot-" + compression + ".bag"));
    std::uint64_t most = 0;
    for (std::size_t cut = 13; cut < whole.size(); cut += 1 + cut % 61) {
      std::istringstream in(whole.substr(0, cut));
      const auto summary = rig::read_ros1_bag(in, [](const rig::Ros1Message&) { return true; });
      CHECK(summary.messages >= most);
      most = std::max(most, summary.messages);
    }
    CHECK(most == 120);
  }
  const auto in = import_foreign({recordings().cut("robot-none.bag", 25'000)});
  CHECK(in.range_mm.size() > 3);
  CHECK(in.range_mm.size() < 20);
  CHECK_THAT(in.notes, Contains("cut off"));
}

TEST_CASE("a ROS 1 bag with one bit changed, wherever, never fails worse than with a message") {
  for (const std::string compression : {"none", "bz2", "lz4"}) {
    const std::string whole = file_text(recordings().file("robot-" + compression + ".bag"));
    std::uint64_t read = 0, runs = 0;
    for (std::size_t at = 13; at < whole.size(); at += 1 + at % 83) {
      std::string bytes = whole;
      bytes[at] = static_cast<char>(bytes[at] ^ 0x10);
      std::istringstream in(bytes);
      read += rig::read_ros1_bag(in, [](const rig::Ros1Message&) { return true; }).messages;
      ++runs;
    }
    CHECK(read > 60 * runs);  // most of the damage costs a chunk at most
  }
}

TEST_CASE("a damaged chunk of a ROS 1 bag is said, and costs that chunk") {
  const std::string whole = file_text(recordings().file("robot-bz2.bag"));
  const std::size_t second = whole.find("BZh", whole.find("BZh") + 3);
  const auto in = import_foreign({recordings().cut("robot-bz2.bag", whole.size(), second + 40)});
  CHECK(in.range_mm.size() >= 15);
  CHECK(in.range_mm.size() < 20);
  CHECK_THAT(in.notes, Contains("chunk of messages is damaged"));
}

TEST_CASE("bags that are none, old or encrypted are refused in words") {
  const TestFolder folder;
  const auto refused = [&](const std::string& bytes) {
    const std::string path = folder / "a.bag";
    std::ofstream(path, std::ios::binary) << bytes;
    return import_foreign({path});
  };
  CHECK_THROWS_WITH(refused("hello"), Contains("not a ROS 1 bag"));
  CHECK_THROWS_WITH(refused("#ROSBAG V1.2\n"), Contains("rosbag migrate"));
  std::string head;
  for (const std::string& field : {std::string("op=\x03"), std::string("encryptor=gpg")})
    head += std::string(1, static_cast<char>(field.size())) + std::string(3, '\0') + field;
  CHECK_THROWS_WITH(refused("#ROSBAG V2.0\n" + std::string(1, static_cast<char>(head.size())) +
                            std::string(3, '\0') + head + std::string(4, '\0')),
                    Contains("encrypted"));
}

TEST_CASE("tables of ranges are read by the names of their columns, in metres or millimetres") {
  rig::ImportOptions beams;
  beams.first_deg = -90, beams.step_deg = 5;
  check_scans(import_named("wide.csv", beams), false);
  check_scans(import_named("echo.csv"), true);  // as rostopic echo -p writes it
  CHECK(import_named("echo.csv").geometry[0].scan_s.value() == Approx(0.1 * 37 * 5 / 360));
  auto bare = with_columns({"time_ms", "range_m*37"});
  bare.first_deg = -90, bare.step_deg = 5;
  check_scans(import_named("bare.txt", bare), false);
  bare.columns = {"time_ms", "range_m*"};
  check_scans(import_named("bare.txt", bare), false);
}

TEST_CASE("a table in metres that does not say so is asked for, not read as millimetres") {
  rig::ImportOptions beams;
  beams.first_deg = -90, beams.step_deg = 5;
  CHECK_THROWS_WITH(import_named("bare.txt", beams), Contains("--columns") && Contains("unit"));
  beams.columns = {"time_ms", "range_mm*37"};  // a wrong answer: every range is then too short to be one
  CHECK_THROWS_WITH(import_named("bare.txt", beams), Contains("no numbers or lie beyond a lidar's reach"));
}

TEST_CASE("tables with one row a point are read: angle and range, or x and y") {
  check_scans(import_named("points.csv"), true);
  const auto cartesian = import_named("cartesian.tsv");
  check_scans(cartesian, false, false);
  CHECK_THAT(cartesian.notes, Contains("no times"));
  check_scans(import_named("degrees.csv"), false, false);
}

TEST_CASE("an angle that may be degrees or radians is asked for") {
  CHECK_THROWS_WITH(import_foreign({recordings().file("points.csv")},
                                   with_columns({"scan", "time_s", "angle", "range_m", "-"})),
                    Contains("degrees or radians"));
}

TEST_CASE("x and y rounded to the millimetre still find their beams") {
  const TestFolder folder;
  std::ofstream out(folder / "xy.csv");
  out << "scan,x_m,y_m\n";
  for (int scan = 0; scan < 3; ++scan)
    for (int beam = 0; beam < 721; ++beam) {
      const double angle = (-90 + 0.25 * beam) * fit::rad_per_deg, range = 0.3 + 0.002 * beam;
      out << scan << ',' << std::round(1000 * range * std::cos(angle)) / 1000 << ','
          << std::round(1000 * range * std::sin(angle)) / 1000 << '\n';
    }
  out.close();
  const auto in = import_foreign({folder / "xy.csv"});
  REQUIRE(in.range_mm.size() == 3);
  CHECK(in.range_mm[0].size() == 721);
  CHECK(in.geometry[0].step_rad * fit::deg_per_rad == Approx(0.25).margin(0.0005));
  CHECK(std::abs(int{in.range_mm[2][700]} - 1700) <= 1);
}

TEST_CASE("a log of wheel ticks becomes a track, over the end of its 16-bit counters") {
  rig::ImportOptions options;
  CHECK_THROWS_WITH(import_named("ticks.csv"), Contains("--ticks-a-turn"));
  options.ticks_a_turn = recordings().expected["ticks_a_turn"].get<double>();
  const auto in = import_named("ticks.csv", options);
  CHECK(in.range_mm.empty());
  check_wheels(in.track, half_tick());
  CHECK_THAT(in.notes, Contains("no scans") && Contains("overflowed 2 times"));
}

TEST_CASE("a log of motion capture and ticks since the row before gives poses and wheels in one track") {
  auto options =
      with_columns({"time_s", "x_m", "y_m", "heading_rad", "right_increment_ticks", "left_increment_ticks"});
  options.ticks_a_turn = recordings().expected["ticks_a_turn"].get<double>();
  const auto in = import_named("steps.csv", options);
  check_odometry(in.track);
  check_wheels(in.track, half_tick());
}

TEST_CASE("wheels and scans of two files join in one session, if they share a clock") {
  rig::ImportOptions options;
  options.ticks_a_turn = recordings().expected["ticks_a_turn"].get<double>();
  const auto joined =
      import_foreign({recordings().file("points.csv"), recordings().file("ticks.csv")}, options);
  check_scans(joined, true);
  check_wheels(joined.track, half_tick());
  CHECK_THROWS_WITH(
      import_foreign({recordings().file("degrees.csv"), recordings().file("ticks.csv")}, options),
      Contains("one clock"));
}

TEST_CASE("CARMEN logs of several lasers, of the logger's times and of a stated resolution are read") {
  for (const char* name : {"old.clf", "new.log"}) {
    INFO(name);
    const auto in = import_named(name);
    check_scans(in, false);
    check_odometry(in.track);
    CHECK(in.bench.lidar.mount.x_mm.value == Approx(100).margin(0.01));
  }
  CHECK_THAT(import_named("old.clf").notes, Contains("RLASER were left out"));
  rig::ImportOptions rear;
  rear.scan_topic = "RLASER";
  CHECK(import_named("old.clf", rear).range_mm.size() == 20);
}

TEST_CASE("a rover's log of BreezySLAM gives scans and wheels") {
  const auto in = import_named("rover.dat");
  REQUIRE(in.range_mm.size() == 20);
  CHECK(in.range_mm[3].size() == 682);
  CHECK(in.range_mm[3][100] == 703);
  CHECK(in.range_mm[3][8] == 0);
  CHECK(in.time_us[2] == 196'000);
  check_wheels(in.track, 2 * 1.01 * fit::pi / 2000);
  CHECK(in.geometry[0].first_rad * fit::deg_per_rad == Approx(-119.53125));
  CHECK(in.bench.lidar.mount.x_mm.value == 145);
  CHECK_THAT(in.notes, Contains("2000 ticks"));
  CHECK(import_foreign({recordings().cut("rover.dat", 20'000)}).range_mm.size() == 6);
}

TEST_CASE(
    "every text format that is cut or damaged anywhere is read as far as it goes, or refused in words") {
  rig::ImportOptions tables;
  tables.first_deg = -90, tables.step_deg = 5, tables.ticks_a_turn = 2000;
  for (const char* name : {"wide.csv", "echo.csv", "points.csv", "cartesian.tsv", "degrees.csv", "ticks.csv",
                           "old.clf", "new.log", "rover.dat"}) {
    INFO(name);
    const rig::ImportOptions options = name == std::string("rover.dat") ? rig::ImportOptions{} : tables;
    const std::size_t size = file_text(recordings().file(name)).size();
    int read = 0;
    for (std::size_t run = 1; run < 16; ++run)
      for (const bool damaged : {false, true}) {
        const std::size_t at = size * run / 16;
        const std::string path = damaged ? recordings().cut(name, size, at) : recordings().cut(name, at);
        try {
          (void)import_foreign({path}, options);
          ++read;
        } catch (const rig::UsageError&) {
        } catch (const rig::MeasurementError&) {
        }
      }
    CHECK(read >= 20);
  }
}

TEST_CASE("what cannot be is refused on import, and taken with a note only when it is asked for") {
  const std::string bag = recordings().file("robot-none.bag");
  rig::ImportOptions fast;
  fast.scan_hz = 40;
  CHECK_THROWS_WITH(import_foreign({bag}, fast), Contains("10.00 Hz") && Contains("40.00 Hz"));
  CHECK_THAT(import_foreign({bag}, fast, true).notes, Contains("not plausible"));
  // Ahead the ranges are about 1.5 m; 15 m is in another unit.
  CHECK_THROWS_WITH(import_foreign({bag}, {}, false, {15000}), Contains("true distance"));
  CHECK(import_foreign({bag}, {}, false, {1500}).range_mm.size() == 20);
}

TEST_CASE("a rate that the recording does not tell is taken from its stamps") {
  CHECK(import_named("new.log").bench.lidar.scan_hz == Approx(10));
}

TEST_CASE("a file that another command reads is reported so") {
  const TestFolder folder;
  std::ofstream(folder / "a.tuple") << R"({"T": 0.8, "phi_l": 0.4, "phi_r": -0.5, "sm": [0, 0, 0]})"
                                    << "\n";
  CHECK_THROWS_WITH(import_foreign({folder / "a.tuple"}), Contains("rig fit odometry"));
  std::ofstream(folder / "b.log.gz") << "\x1f\x8b";
  CHECK_THROWS_WITH(import_foreign({folder / "b.log.gz"}), Contains("unpack"));
}

TEST_CASE("columns that name nothing, or no table, are refused with what there is") {
  CHECK_THROWS_WITH(import_named("bare.txt", with_columns({"time_s", "speed"})),
                    Contains("speed") && Contains("left_ticks"));
  CHECK_THROWS_WITH(import_named("robot-none.bag", with_columns({"time_s", "range_m*3"})),
                    Contains("is not a table"));
}

TEST_CASE("the public logs of a rover and of a robot in motion capture are read whole") {
  const fs::path real = fs::path(RIG_SOURCE_DIR) / "../shared/real";
  if (!fs::exists(real / "mines-rover")) {
    WARN("skipped: the public recordings are not beside the project (../shared/real)");
    return;
  }
  const auto rover = import_foreign({(real / "mines-rover/exp1.dat").string()});
  CHECK(rover.range_mm.size() == 756);
  CHECK(rover.track.size() == 756);
  auto options =
      with_columns({"time_s", "x_m", "y_m", "heading_rad", "right_increment_ticks", "left_increment_ticks"});
  options.ticks_a_turn = 43.7 * 64;
  const auto run =
      import_foreign({(real / "optiodom/circular/231220200121/231220200121_run-01.csv").string()}, options);
  CHECK(run.track.size() > 1000);
  CHECK(run.track.back().wheel_left_rad.value() > 10);
}

}  // namespace import_foreign_test
