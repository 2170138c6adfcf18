// SPDX-License-Identifier: MIT
#include <hdf5.h>

#include <catch2/catch.hpp>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "fit/range/correction.hpp"
#include "rig/errors.hpp"
#include "rig/export/exporter.hpp"
#include "rig/import/cdr.hpp"
#include "rig/import/mcap.hpp"
#include "rig/live/session_state.hpp"
#include "tests/support/test_folder.hpp"

namespace export_test {
namespace {

using Catch::Matchers::Contains;

/// Two captures: 3 scans of 4 beams with intensity, 300 scans of 2 beams without.
std::string small_session(const TestFolder& folder) {
  const std::string path = folder / "run.rig";
  rig::SessionStore store(path, rig::SessionStore::Mode::create);
  store.set("created_utc", "2026-01-02T03:04:05Z");
  store.set("bench", R"({"schema": "bench/1"})");
  fit::CaptureInfo info;
  info.step = "near, \"white\"";
  info.stage_rad = 12.5 * fit::rad_per_deg;
  info.first_step = 540;
  info.last_step = 543;
  const auto with_intensity = store.begin_capture(info);
  for (std::uint16_t i = 0; i < 3; ++i) {
    const std::vector<std::uint16_t> range = {static_cast<std::uint16_t>(1000 + i), 1001, 0, 65535},
                                     intensity = {7, 8, 9, 10};
    fit::ScanView scan;
    scan.seq = i;
    scan.device_ms = 25 * i;
    scan.host_us = 25000 * i;
    scan.range_mm = range;
    scan.intensity = intensity;
    store.add_scan(with_intensity, scan);
  }
  store.commit_capture(with_intensity);
  info.step = "many";
  info.last_step = 541;
  const auto many = store.begin_capture(info);
  for (int i = 0; i < 300; ++i) {
    const std::vector<std::uint16_t> range = {static_cast<std::uint16_t>(i + 1), 5};
    fit::ScanView scan;
    scan.seq = i;
    scan.host_us = 1'000'000 + 25000 * i;
    scan.range_mm = range;
    store.add_scan(many, scan);
  }
  store.commit_capture(many);
  store.add_result("noise", R"({"schema": "result/1", "kind": "noise"})");
  return path;
}

std::string exported(const TestFolder& folder, const std::string& format) {
  const std::string path = small_session(folder), out = folder / ("out." + format);
  const rig::SessionStore session(path, rig::SessionStore::Mode::read);
  rig::run_export(format, {path, &session}, rig::check_output({out}));
  return out;
}

}  // namespace

TEST_CASE("CSV has one row for each value, quoted where commas are") {
  const TestFolder folder;
  const std::string text = file_text(exported(folder, "csv"));
  std::istringstream lines(text);
  std::vector<std::string> rows;
  for (std::string line; std::getline(lines, line);) rows.push_back(line);
  REQUIRE(rows.size() == 1 + 3 * 4 + 300 * 2);
  CHECK(rows[1] == "1,\"near, \"\"white\"\"\",12.5,,0,0,0,0,540,0,1000,7");
  CHECK(rows[4] == "1,\"near, \"\"white\"\"\",12.5,,0,0,0,0,543,0.75,65535,10");
  CHECK(rows.back() == "2,many,12.5,,0,299,0,8475000,541,0.25,5,");
}

TEST_CASE("HDF5 holds every scan of every capture") {
  const TestFolder folder;
  const std::string path = exported(folder, "hdf5");
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  REQUIRE(file >= 0);
  const hid_t data = H5Dopen2(file, "/captures/2/range_mm", H5P_DEFAULT);
  REQUIRE(data >= 0);
  const hid_t space = H5Dget_space(data);
  hsize_t size[2] = {};
  REQUIRE(H5Sget_simple_extent_dims(space, size, nullptr) == 2);
  CHECK(size[0] == 300);
  CHECK(size[1] == 2);
  std::vector<std::uint16_t> values(600);
  REQUIRE(H5Dread(data, H5T_NATIVE_UINT16, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) >= 0);
  for (std::size_t i = 0; i < 300; ++i) REQUIRE(values[2 * i] == i + 1);
  CHECK(H5Lexists(file, "/captures/1/intensity", H5P_DEFAULT) > 0);
  CHECK(H5Lexists(file, "/captures/2/intensity", H5P_DEFAULT) == 0);
  H5Sclose(space);
  H5Dclose(data);
  H5Fclose(file);
}

TEST_CASE("h5py opens the HDF5 file") {
  if (std::system("/usr/bin/python3 -c 'import h5py' 2>/dev/null") != 0) {
    WARN("skipped: python3-h5py is not installed");
    return;
  }
  const TestFolder folder;
  const std::string path = exported(folder, "hdf5");
  const std::string script =
      "import h5py, sys; f = h5py.File(sys.argv[1]); c = f['captures/1']; "
      "assert c['range_mm'].shape == (3, 4); assert c['range_mm'][2, 0] == 1002; assert c.attrs['stage_deg'] "
      "== 12.5; "
      "assert c['step'].asstr()[()] == 'near, \"white\"'";
  std::ofstream(folder / "check.py") << script;
  CHECK(std::system(("/usr/bin/python3 " + folder / "check.py" + " " + path).c_str()) == 0);
}

TEST_CASE("a ROS 2 bag gives back each scan in metres with its time and angles") {
  const TestFolder folder;
  std::ifstream file(exported(folder, "mcap"), std::ios::binary);
  int scans = 0, joints = 0;
  const auto summary = rig::read_mcap(file, [&](const rig::McapMessage& message) {
    rig::CdrReader in(message.data);
    const auto seconds = in.value<std::int32_t>();
    const auto nanoseconds = in.value<std::uint32_t>();
    CHECK(message.log_time_ns == static_cast<std::uint64_t>(seconds) * 1'000'000'000 + nanoseconds);
    if (message.type == "sensor_msgs/msg/JointState") {
      ++joints;
      return true;
    }
    REQUIRE(message.type == "sensor_msgs/msg/LaserScan");
    if (scans++ != 1) return true;
    CHECK(seconds == 1767323045);  // 2026-01-02T03:04:05Z
    CHECK(nanoseconds == 25'000'000);
    CHECK(in.text() == "laser");
    CHECK(in.value<float>() == Approx(0));
    CHECK(in.value<float>() == Approx(0.75 * fit::rad_per_deg));
    CHECK(in.value<float>() == Approx(0.25 * fit::rad_per_deg));
    CHECK(in.value<float>() == Approx(0.025 / 1440));
    CHECK(in.value<float>() == Approx(0.025));
    in.skip<float>(2);
    const auto ranges = in.sequence<float>();
    REQUIRE(ranges.size() == 4);
    CHECK(ranges[0] == Approx(1.001));
    CHECK(std::isinf(ranges[2]));
    CHECK(in.sequence<float>() == std::vector<float>{7, 8, 9, 10});
    return true;
  });
  CHECK(scans == 303);
  CHECK(joints == 303);
  CHECK_FALSE(summary.truncated);
  CHECK(summary.notes.empty());
}

TEST_CASE("a ROS 2 bag counts from the session's epoch, to the microsecond") {
  const TestFolder folder;
  const std::string path = small_session(folder), out = folder / "out.mcap";
  { rig::SessionStore(path, rig::SessionStore::Mode::append).set("epoch_unix_us", "1767323045678901"); }
  const rig::SessionStore session(path, rig::SessionStore::Mode::read);
  rig::run_export("mcap", {path, &session}, rig::check_output({out}));
  std::ifstream file(out, std::ios::binary);
  std::uint64_t first_ns = 0;
  (void)rig::read_mcap(file, [&](const rig::McapMessage& message) {
    if (first_ns == 0) first_ns = message.log_time_ns;
    return true;
  });
  CHECK(first_ns == 1'767'323'045'678'901'000);
}

TEST_CASE("a cluster's value stands for the middle of its steps: in tables, in bags and on the page") {
  const TestFolder folder;
  const std::string path = folder / "clusters.rig";
  {
    rig::SessionStore store(path, rig::SessionStore::Mode::create);
    store.set("bench", R"({"schema": "bench/1"})");  // 0.25 deg a step, ahead at step 540
    fit::CaptureInfo info;
    info.first_step = 540, info.last_step = 550, info.cluster = 3;  // 540-542, 543-545, 546-548, 549-550
    const auto id = store.begin_capture(info);
    const std::vector<std::uint16_t> range = {1000, 1001, 1002, 1003};
    fit::ScanView scan;
    scan.range_mm = range;
    store.add_scan(id, scan);
    store.commit_capture(id);
  }
  const rig::SessionStore session(path, rig::SessionStore::Mode::read);

  rig::run_export("csv", {path, &session}, rig::check_output({folder / "out.csv"}));
  std::istringstream lines(file_text(folder / "out.csv"));
  std::vector<std::string> rows;
  for (std::string line; std::getline(lines, line);) rows.push_back(line);
  REQUIRE(rows.size() == 5);
  CHECK_THAT(rows[1], Catch::EndsWith(",540,0.25,1000,"));
  CHECK_THAT(rows[3], Catch::EndsWith(",546,1.75,1002,"));
  CHECK_THAT(rows[4],
             Catch::EndsWith(",549,2.375,1003,"));  // A short one, whose middle is between two steps.

  rig::run_export("mcap", {path, &session}, rig::check_output({folder / "out.mcap"}));
  std::ifstream bag(folder / "out.mcap", std::ios::binary);
  int scans = 0;
  (void)rig::read_mcap(bag, [&](const rig::McapMessage& message) {
    if (message.type != "sensor_msgs/msg/LaserScan") return true;
    ++scans;
    rig::CdrReader in(message.data);
    in.skip<std::int32_t>(2);
    (void)in.text();
    CHECK(in.value<float>() == Approx(0.25 * fit::rad_per_deg));
    CHECK(in.value<float>() == Approx(2.5 * fit::rad_per_deg));
    CHECK(in.value<float>() == Approx(0.75 * fit::rad_per_deg));
    return true;
  });
  CHECK(scans == 1);

  const auto shown = rig::state_of(session).at("scan");
  CHECK(shown.at("first_deg").get<double>() == Approx(0.25));
  CHECK(shown.at("step_deg").get<double>() == Approx(0.75));
}

TEST_CASE("JSON holds circumstances and results") {
  const TestFolder folder;
  const auto document = nlohmann::json::parse(file_text(exported(folder, "json")));
  CHECK(document.at("captures").size() == 2);
  CHECK(document.at("captures")[0].at("stage_deg") == 12.5);
  CHECK(document.at("results").at("noise").at("kind") == "noise");
}

TEST_CASE("an export that fails leaves nothing behind and says what is wrong") {
  const TestFolder folder;
  const std::string path = small_session(folder);
  const rig::SessionStore session(path, rig::SessionStore::Mode::read);
  CHECK_THROWS_WITH(rig::run_export("cvs", {path, &session}, rig::check_output({folder / "x"})),
                    Contains("did you mean 'csv'"));
  CHECK_THROWS_AS(rig::run_export("csv", {path, &session}, rig::check_output({folder / "none/x.csv"})),
                  rig::UsageError);
  CHECK_THROWS_WITH(
      rig::run_export("csv", {folder / "a.json", nullptr}, rig::check_output({folder / "x.csv"})),
      Contains("is not a session file"));
  CHECK(folder.names().size() <= 3);  // the session and its log
}

TEST_CASE("the Python example reads a session with the standard library alone") {
  const TestFolder folder;
  const std::string path = small_session(folder);
  const std::string command =
      "python3 " RIG_SOURCE_DIR "/docs/examples/read_session.py " + path + " > " + folder / "out.txt";
  REQUIRE(std::system(command.c_str()) == 0);
  CHECK_THAT(file_text(folder / "out.txt"), Contains("1\tnear, \"white\"\t12.50\t540\t1001.000\t3"));
  CHECK_THAT(file_text(folder / "out.txt"), Contains("2\tmany\t12.50\t540\t150.500\t300"));
}

TEST_CASE(
    "the rotation centre of a session of its own goes along into the formats that have a place for it") {
  const TestFolder folder;
  fit::Correction correction;
  correction.range =
      fit::CorrectionTerm{fit::CorrectionTerm::Argument::range, "line", {1, 0.002}, 200, 9800, {}, {}, {}};
  correction.factor =
      Eigen::MatrixXd::Constant(static_cast<Eigen::Index>(correction.parameter_names().size()), 1, 1e-3);
  correction.lidar_model = "UST-10LX", correction.lidar_serial = "H1";
  std::ofstream(folder / "correction.json") << fit::to_json_text(correction);
  const auto session_of = [&](const std::string& serial, const std::string& result) {
    const std::string path = folder / (serial + (result.empty() ? "-none" : "") + ".rig");
    rig::SessionStore store(path, rig::SessionStore::Mode::create);
    store.set("lidar", R"({"version": {"PROD": "UST-10LX", "SERI": ")" + serial + "\"}}");
    if (!result.empty()) store.add_result("centre", result);
    return path;
  };
  const std::string centre = R"({"values": [{"name": "centre_x_mm", "value": -1.625},
                                            {"name": "centre_y_mm", "value": -12.5}]})";
  const auto exported_with = [&](const std::string& format, const std::string& from, bool any_lidar = false) {
    const rig::SessionStore session(from, rig::SessionStore::Mode::read);
    rig::run_export(format, {folder / "correction.json", nullptr, any_lidar, &session},
                    rig::check_output({folder / format}));
    return file_text(folder / format);
  };
  const std::string own = session_of("H1", centre), other = session_of("H2", centre);
  CHECK_THAT(exported_with("c-header", own), Contains("lidar_range_centre_mm[2] = {-1.625, -12.5}"));
  CHECK_THAT(exported_with("cpp-header", own), Contains("centre_mm[2] = {-1.625, -12.5}"));
  CHECK_THAT(exported_with("ros2-parameters", own),
             Contains("centre_mm: [-1.625, -12.5]") && Contains("centre_calibrated: true"));
  CHECK_THROWS_WITH(exported_with("csv-table", own), Contains("no place for a rotation centre"));
  CHECK_THROWS_WITH(exported_with("c-header", other), Contains("H2") && Contains("--any-lidar"));
  CHECK_THAT(exported_with("c-header", other, true), Contains("{-1.625, -12.5}"));
  CHECK_THROWS_WITH(exported_with("c-header", session_of("H1", "")), Contains("holds no rotation centre"));
}

TEST_CASE(
    "a correction from one surface is outside everywhere else, in every form, and its warnings go along") {
  const TestFolder folder;
  fit::Correction correction;
  correction.range =
      fit::CorrectionTerm{fit::CorrectionTerm::Argument::range, "line", {1, 0.002}, 200, 9800, {}, {}, {}};
  correction.factor =
      Eigen::MatrixXd::Constant(static_cast<Eigen::Index>(correction.parameter_names().size()), 1, 1e-3);
  correction.measured = {{200, 2000, 2000}, {1000, 1800, 1800}, {9800, 170, 170}};
  correction.notes = {"only one surface was measured"};
  const fit::Correction read = fit::parse_correction(fit::to_json_text(correction));
  REQUIRE(read.measured.size() == 3);
  struct Look {
    double mm, counts;
    bool inside;
  };
  const std::vector<Look> looks = {{1050, 1800, true}, {1050, 200, false}, {250, 2100, true},
                                   {9900, 170, false}, {5000, 1000, true}, {5000, 1400, false}};
  for (const Look& look : looks) {
    INFO(look.mm << " mm, " << look.counts);
    CHECK(read.apply(look.mm, look.counts).inside() == look.inside);
  }
  std::ofstream(folder / "c.json") << fit::to_json_text(correction);
  for (const char* format : {"c-header", "cpp-header", "ros2-parameters"}) {
    rig::run_export(format, {folder / "c.json", nullptr}, rig::check_output({folder / format}));
    CHECK_THAT(file_text(folder / format), Contains("only one surface was measured"));
  }
  CHECK_THAT(file_text(folder / "ros2-parameters"),
             Contains("measured_intensity_to: [2000.0, 1800.0, 170.0]"));
  std::string program =
      "#include \"correction.hpp\"\nextern \"C\" {\n#include \"correction.h\"\n}\nint main() {\n  double "
      "mm;\n";
  for (const Look& look : looks) {
    const std::string arguments = std::to_string(look.mm) + ", " + std::to_string(look.counts);
    program += "  if (lidar_range::correct(" + arguments +
               ").inside() != " + (look.inside ? "true" : "false") + " || (lidar_range_correct(" + arguments +
               ", &mm) == 0) != " + (look.inside ? "true" : "false") + ") return 1;\n";
  }
  std::filesystem::rename(folder / "c-header", folder / "correction.h");
  std::filesystem::rename(folder / "cpp-header", folder / "correction.hpp");
  std::ofstream(folder / "main.cpp") << program << "  return 0;\n}\n";
  REQUIRE(std::system(("g++ -Wall -Werror -o " + folder / "main" + " " + folder / "main.cpp").c_str()) == 0);
  CHECK(std::system((folder / "main").c_str()) == 0);
  // Without a term of distance, only the measured one.
  fit::Correction near = correction;
  near.range.reset();
  near.intensity = fit::CorrectionTerm{
      fit::CorrectionTerm::Argument::intensity, "line", {1, 0.002}, 100, 2400, {}, {}, {}};
  near.factor = Eigen::MatrixXd::Constant(static_cast<Eigen::Index>(near.parameter_names().size()), 1, 1e-3);
  near.measured = {{200, 100, 2400}};
  CHECK(near.apply(203, 500).inside());
  CHECK_FALSE(near.apply(1000, 500).inside());
}

}  // namespace export_test
