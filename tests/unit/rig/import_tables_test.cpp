// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <filesystem>

#include "fit/numeric/angle.hpp"
#include "rig/errors.hpp"
#include "rig/import/import_session.hpp"
#include "rig/session/session_store.hpp"
#include "tests/support/test_folder.hpp"

namespace import_tables_test {
namespace {

namespace fs = std::filesystem;
using Catch::Matchers::Contains;

struct Scan {
  std::vector<std::uint16_t> range_mm, intensity;
  std::int64_t host_us = 0;
  fit::ScanGeometry geometry;
};

struct Imported {
  rig::ImportReport report;
  std::vector<Scan> scans;
  std::string notes;
};

Imported import(const TestFolder& folder, const std::string& file, rig::ImportOptions options = {}) {
  rig::ImportRequest request;
  request.files = {file};
  fs::remove(folder / "out.rig");
  request.output = rig::check_output({folder / "out.rig"});
  request.options = options;
  Imported out;
  out.report = rig::import_session(request);
  for (const auto& note : out.report.notes) out.notes += note + "\n";
  const rig::SessionStore store(request.output.path(), rig::SessionStore::Mode::read);
  const auto recording = store.recording();
  recording->for_each_scan(0, [&](const fit::ScanView& scan) {
    out.scans.push_back({{scan.range_mm.begin(), scan.range_mm.end()},
                         {scan.intensity.begin(), scan.intensity.end()},
                         scan.host_us,
                         scan.geometry.value_or(fit::ScanGeometry{})});
  });
  return out;
}

const std::string ubh_header =
    "[appName]\r\nUrgBenri\r\n[model]\r\nUST-10LX(Hokuyo Automatic "
    "Co.,Ltd.)\r\n[serialNumber]\r\nH1234567\r\n"
    "[frontStep]\r\n540\r\n[totalSteps]\r\n1440\r\n[startStep]\r\n538\r\n[endStep]\r\n542\r\n[grouping]"
    "\r\n1\r\n"
    "[motorSpeed]\r\n2400\r\n[scanMsec]\r\n25\r\n[captureMode]\r\nGE_Capture_mode\r\n";

std::string ubh_scan(long ms, const std::string& values) {
  return "[timestamp]\r\n" + std::to_string(ms) + "\r\n[logtime]\r\n2024-05-06 07:08:09.123\r\n[scan]\r\n" +
         values + "\r\n";
}

}  // namespace

TEST_CASE("a UrgBenri log becomes a session with the lidar's own angles and times") {
  const TestFolder folder;
  const auto in = import(
      folder,
      folder.write("a.ubh", ubh_header + ubh_scan(16'777'200, "1000|2000;1001|2001;4|0;1003|2003;65533|0") +
                                ubh_scan(9, "1010|2010;1011|2011;1012|2012;1013|2013;1014|2014")));
  REQUIRE(in.scans.size() == 2);
  CHECK(in.scans[0].range_mm == std::vector<std::uint16_t>{1000, 1001, 0, 1003, 0});
  CHECK(in.scans[0].intensity == std::vector<std::uint16_t>{2000, 2001, 0, 2003, 0});
  CHECK(in.scans[0].geometry.first_rad * fit::deg_per_rad == Approx(-0.5));
  CHECK(in.scans[0].geometry.step_rad * fit::deg_per_rad == Approx(0.25));
  CHECK(in.scans[0].geometry.scan_s.value() == Approx(0.025 * 5 / 1440));
  CHECK(in.scans[1].host_us - in.scans[0].host_us == 25'000);  // over the wrap of the 24-bit timer
  const rig::SessionStore store(folder / "out.rig", rig::SessionStore::Mode::read);
  CHECK_THAT(store.get("lidar").value(), Contains("UST-10LX") && Contains("H1234567"));
  CHECK_FALSE(store.get("recorded_utc"));  // Its times are the lidar's own.
  CHECK(store.get("recorded_local") == "2024-05-06 07:08:09.123");
}

TEST_CASE("a UrgBenri log of several echoes, without intensity, cut at its end, is read as far as it goes") {
  const TestFolder folder;
  const auto in = import(
      folder, folder.write("b.ubh", ubh_header + ubh_scan(100, "500&900;501;502;503;504") +
                                        ubh_scan(125, "510;511;512;513;514") + ubh_scan(150, "520;52")));
  REQUIRE(in.scans.size() == 2);
  CHECK(in.scans[0].range_mm.front() == 500);
  CHECK(in.scans[0].intensity.empty());
  CHECK_THAT(in.notes, Contains("several echoes") && Contains("1 scans were truncated"));
}

TEST_CASE(
    "a UrgBenri log that does not say its steps is understood for known models and refused for others") {
  const TestFolder folder;
  const auto in = import(folder, folder.write("c.ubh", "[model]\nUST-20LX\n" + ubh_scan(1, "100;200;300") +
                                                           ubh_scan(26, "100;200;300")));
  CHECK(in.scans[0].geometry.first_rad * fit::deg_per_rad == Approx(-135));
  CHECK_THAT(in.notes, Contains("were assumed"));
  CHECK_THROWS_WITH(import(folder, folder.write("d.ubh", "[model]\nXYZ\n" + ubh_scan(1, "100;200;300"))),
                    Contains("frontStep"));
  CHECK_THROWS_WITH(import(folder, folder.write("e.ubh", ubh_header)), Contains("holds no scan"));
}

TEST_CASE("a table with one row a scan is read, as UrgBenri writes it and without any header") {
  const TestFolder folder;
  std::string text = "Timestamp,", second = "Timestamp,";
  for (int k = 0; k < 3; ++k)
    for (int echo = 0; echo < 3; ++echo) {
      text += "Step " + std::to_string(k) + ",";
      second += "Range " + std::to_string(echo) + ",";
    }
  text += "\n" + second + "\n1000,500,0,0,600,900,0,3,0,0,\n1025,501,0,0,601,901,0,701,0,0,\n";
  rig::ImportOptions options;
  options.first_deg = -10;
  options.step_deg = 0.5;
  const auto in = import(folder, folder.write("urgbenri.csv", text), options);
  REQUIRE(in.scans.size() == 2);
  CHECK(in.scans[0].range_mm == std::vector<std::uint16_t>{500, 600, 0});
  CHECK(in.scans[1].range_mm == std::vector<std::uint16_t>{501, 601, 701});
  CHECK(in.scans[1].host_us == 25'000);
  CHECK(in.scans[0].geometry.first_rad * fit::deg_per_rad == Approx(-10));
  CHECK_THAT(in.notes, Contains("several echoes"));
  CHECK_THROWS_WITH(import(folder, folder / "urgbenri.csv"), Contains("--first-deg"));

  std::string bare;
  for (int row = 0; row < 2; ++row) {
    for (int k = 0; k < 1081; ++k) bare += (k ? "; " : "") + std::to_string(1000 + row + k);
    bare += "\n";
  }
  const auto plain = import(folder, folder.write("bare.csv", bare));
  REQUIRE(plain.scans.size() == 2);
  CHECK(plain.scans[1].range_mm.size() == 1081);
  CHECK(plain.scans[1].range_mm[7] == 1008);
  CHECK(plain.scans[1].host_us == 25'000);
  CHECK(plain.scans[0].geometry.first_rad * fit::deg_per_rad == Approx(-135));
  CHECK_THAT(plain.notes, Contains("UST-10LX"));
}

TEST_CASE("a table with one row a value is read, as rig export writes it") {
  const TestFolder folder;
  std::string text =
      "capture,step,stage_deg,target,target_shift_mm,seq,device_ms,host_us,beam,beam_deg,range_mm,"
      "intensity\n";
  for (int seq = 0; seq < 3; ++seq)
    for (int beam = 0; beam < 4; ++beam)
      text += "1,cap,0,,0," + std::to_string(seq) + ",5," + std::to_string(7000 + 25'000 * seq) + "," +
              std::to_string(beam) + "," + std::to_string(-0.5 + 0.25 * beam) + "," +
              std::to_string(1000 + 10 * seq + beam) + ",2400\n";
  const auto in = import(folder, folder.write("export.csv", text));
  REQUIRE(in.scans.size() == 3);
  CHECK(in.scans[2].range_mm == std::vector<std::uint16_t>{1020, 1021, 1022, 1023});
  CHECK(in.scans[2].intensity == std::vector<std::uint16_t>(4, 2400));
  CHECK(in.scans[2].host_us == 50'000);
  CHECK(in.scans[0].geometry.first_rad * fit::deg_per_rad == Approx(-0.5));
  CHECK(in.scans[0].geometry.step_rad * fit::deg_per_rad == Approx(0.25));
}

TEST_CASE("decimal commas, feet and the header of a second file are read as what they are") {
  const TestFolder folder;
  std::string text;
  for (int scan = 0; scan < 3; ++scan) {
    if (scan < 2) text += "angle_deg;range_ft\n";
    for (int beam = 0; beam < 90; ++beam)
      text += std::to_string(beam) + ",5;" + std::to_string(10 + beam % 4) + ",5\n";
  }
  const auto in = import(folder, folder.write("feet.csv", text));
  REQUIRE(in.scans.size() == 3);
  REQUIRE(in.scans[2].range_mm.size() == 90);
  CHECK(in.scans[2].range_mm[0] == 3200);
  CHECK(in.scans[2].range_mm[89] == 3505);
  CHECK(in.scans[0].geometry.first_rad * fit::deg_per_rad == Approx(0.5));
}

TEST_CASE("a row of a table that ends before its time is left out") {
  const TestFolder folder;
  rig::ImportOptions options;
  options.first_deg = 0;
  options.step_deg = 1;
  const auto in =
      import(folder, folder.write("cut.csv", "a,b,host_us\n500,600,1000\n501,601\n502,602,51000\n"), options);
  REQUIRE(in.scans.size() == 2);
  CHECK(in.scans[1].range_mm == std::vector<std::uint16_t>{502, 602});
  CHECK(in.scans[1].host_us == 50'000);
  CHECK_THAT(in.notes, Contains("1 of 3 rows were truncated"));
}

TEST_CASE("names with their units in brackets are one name each, separated by blanks too") {
  const TestFolder folder;
  std::string text = "# angle (deg) range (mm)\n";
  for (int scan = 0; scan < 3; ++scan)
    for (int beam = -45; beam <= 45; ++beam)
      text += std::to_string(beam) + " " + std::to_string(1000 + beam) + "\n";
  const auto imported = import(folder, folder.write("points.txt", text));
  REQUIRE(imported.scans.size() == 3);
  REQUIRE(imported.scans[0].range_mm.size() == 91);
  CHECK(imported.scans[0].range_mm[0] == 955);
  CHECK(imported.scans[2].range_mm[90] == 1045);
  CHECK(imported.scans[0].geometry.first_rad == Approx(-fit::pi / 4));
}

TEST_CASE("zeros that damage a table cost the rows they stand in") {
  const TestFolder folder;
  std::string text = "scan,angle_deg,range_mm\n";
  for (int scan = 0; scan < 4; ++scan)
    for (int beam = 0; beam < 30; ++beam)
      text += std::to_string(scan) + "," + std::to_string(beam) + "," + std::to_string(1000 + beam) + "\n";
  text[text.find("0,7,1007") + 2] = '\0';
  const auto imported = import(folder, folder.write("points.csv", text));
  CHECK(imported.scans.size() == 4);
  CHECK_THAT(imported.notes,
             Contains("1 of 120 rows were truncated or implausible") && Contains("first in line 9"));
  CHECK_THROWS_WITH(import(folder, folder.write("binary.csv", std::string(400, '\0') + text)),
                    Contains("does not read"));
}

TEST_CASE("poses alone are refused, and what is missing is said") {
  const TestFolder folder;
  const std::string file =
      folder.write("poses.csv", "time_s,x_m,y_m,heading_rad\n0,0,0,0\n1,0.1,0,0\n2,0.2,0,0\n");
  CHECK_THROWS_WITH(import(folder, file),
                    Contains("holds poses and no scan") && Contains("Give the file with the scans too"));
}

TEST_CASE("tables that are none are refused in words") {
  const TestFolder folder;
  CHECK_THROWS_AS(import(folder, folder.write("words.csv", "hello,world\nand,more\n")), std::exception);
  CHECK_THROWS_WITH(
      import(folder, folder.write("level.csv", "Timestamp,Step 0,Step 1\nTimestamp,Level,Level\n1,2,3\n")),
      Contains("intensities without ranges"));
  CHECK_THROWS_WITH(import(folder, folder.write("header.csv", "Timestamp,Step 0\n")),
                    Contains("holds no scan"));
}

}  // namespace import_tables_test
