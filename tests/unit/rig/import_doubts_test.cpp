// SPDX-License-Identifier: MIT
// What a careless user may give to `rig import`, table by table: a wrong recording is refused or told.
#include <catch2/catch.hpp>
#include <cmath>
#include <functional>

#include "fit/angle.hpp"
#include "rig/errors.hpp"
#include "rig/import/import_session.hpp"
#include "tests/support/test_folder.hpp"

namespace import_doubts_test {
namespace {

using Catch::Matchers::Contains;

struct Asked {
  rig::ImportOptions options;
  bool accept_doubts = false;
};

Asked with(std::vector<std::string> columns, double first_deg = -90, double step_deg = 0.5) {
  Asked asked;
  asked.options.columns = std::move(columns);
  asked.options.first_deg = first_deg;
  asked.options.step_deg = step_deg;
  return asked;
}

/// The notes, a line each.
std::string import(const TestFolder& folder, const std::vector<std::string>& files,
                   const Asked& asked = with({})) {
  rig::ImportRequest request;
  request.files = files;
  std::filesystem::remove(folder / "out.rig");
  request.output = rig::check_output({folder / "out.rig"});
  request.options = asked.options;
  request.accept_doubts = asked.accept_doubts;
  std::string notes;
  for (const auto& note : rig::import_session(request).notes) notes += note + "\n";
  return notes;
}

constexpr int scans = 20, beams = 41;

int range_mm(int scan, int beam) { return 700 + 40 * beam + scan; }
double time_s(int scan) { return 0.025 * scan; }

using Cell = std::function<std::string(int scan, int beam)>;

std::string plain(int scan, int beam) { return std::to_string(range_mm(scan, beam)); }

std::string text_of(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.9g", value);
  return text;
}

/// One row a scan: the header, times, ranges.
std::string scan_rows(const std::string& header, const std::function<double(int)>& time,
                      const Cell& cell = plain, const std::string& separator = ",") {
  std::string text = header.empty() ? "" : header + "\n";
  for (int scan = 0; scan < scans; ++scan) {
    text += text_of(time(scan));
    for (int beam = 0; beam < beams; ++beam) text += separator + cell(scan, beam);
    text += "\n";
  }
  return text;
}

std::string header(const std::string& time) {
  std::string names = time;
  for (int beam = 0; beam < beams; ++beam) names += ",range" + std::to_string(beam) + "_mm";
  return names;
}

/// One row a point: scan, angle, range.
std::string point_rows(const std::string& angle_name, const std::function<double(int)>& angle,
                       const Cell& cell = plain) {
  std::string text = "scan," + angle_name + ",range_mm\n";
  for (int scan = 0; scan < scans; ++scan)
    for (int beam = 0; beam < beams; ++beam)
      text += std::to_string(scan) + "," + text_of(angle(beam)) + "," + cell(scan, beam) + "\n";
  return text;
}

std::string log_rows(const std::string& header, const std::function<std::string(double time)>& row) {
  std::string text = header + "\n";
  for (int i = 0; i < 60; ++i) text += text_of(0.05 * i) + "," + row(0.05 * i) + "\n";
  return text;
}

}  // namespace

TEST_CASE("times in another unit, times that go back and pauses are told") {
  const TestFolder folder;
  const auto notes_of = [&](const std::string& name, const std::function<double(int)>& time) {
    return import(folder, {folder.write("times.csv", scan_rows(header(name), time))});
  };
  CHECK_THROWS_WITH(notes_of("time_ms", time_s), Contains("40000") && Contains("unit of the times"));
  CHECK_THROWS_WITH(notes_of("time_s", [](int scan) { return 25.0 * scan; }),
                    Contains("0.040 Hz") && Contains("unit of the times"));
  CHECK_THROWS_WITH(notes_of("time_s", [](int scan) { return time_s(scan) - (scan < 12 ? 0 : 0.25); }),
                    Contains("1 of its 20 scans are stamped earlier") && Contains("scan 13, by 0.225 s"));
  CHECK_THAT(notes_of("time_s", [](int scan) { return time_s(scan) + (scan < 12 ? 0 : 3600); }),
             Contains("1 of its 20 scans come after a pause") && Contains("scan 13, after 3600"));
  CHECK_THAT(notes_of("time_s", [](int scan) { return time_s(scan - scan % 2); }),
             Contains("10 of its 20 scans carry the time of the scan before"));
}

TEST_CASE("an import that no command could read is not written, whatever is accepted") {
  const TestFolder folder;
  auto asked = with({});
  asked.accept_doubts = true;
  asked.options.scan_hz = 40'000;
  CHECK_THROWS_WITH(import(folder, {folder.write("fast.csv", scan_rows(header("time_s"), time_s))}, asked),
                    Contains("lidar/scan_hz") && Contains("--scan-hz"));
  CHECK_FALSE(std::filesystem::exists(folder / "out.rig"));
}

TEST_CASE("degrees that are said to be radians, and radians that are said to be degrees, are refused") {
  const TestFolder folder;
  const auto radians = [](int beam) { return (-90 + 4.5 * beam) * fit::rad_per_deg; };
  // A narrow fan in degrees is still more than a turn in radians.
  CHECK_THROWS_WITH(
      import(folder,
             {folder.write("b.csv", point_rows("angle_rad", [](int beam) { return -8 + 0.4 * beam; }))}, {}),
      Contains("more than a full turn"));
  CHECK_THROWS_WITH(import(folder, {folder.write("c.csv", point_rows("angle_deg", radians))}, {}),
                    Contains("3.1416 deg") && Contains("likely radians"));
  const auto wide = folder.write("wide.csv", scan_rows(header("time_s"), time_s));
  CHECK_THROWS_WITH(import(folder, {wide}, with({}, -1.5707, 0.008726)), Contains("likely radians"));
  auto accepted = with({}, -180, 30);
  accepted.accept_doubts = true;
  CHECK_THROWS_WITH(import(folder, {wide}, accepted), Contains("more than a full turn"));
  CHECK(import(folder, {wide}, with({}, -2.5, 0.125)).empty());  // a narrow fan of fine steps
}

TEST_CASE("robots that are too fast are refused, with the units to check") {
  const TestFolder folder;
  const auto wide = folder.write("wide.csv", scan_rows(header("time_s"), time_s));
  const auto notes_of = [&](const std::string& header, const std::function<std::string(double)>& row,
                            bool accept = false) {
    auto asked = with({});
    asked.accept_doubts = accept;
    asked.options.ticks_a_turn = 2000;
    return import(folder, {wide, folder.write("log.csv", log_rows(header, row))}, asked);
  };
  const auto turning = [](double time) { return "0,0," + text_of(18 * time); };
  CHECK_THROWS_WITH(notes_of("time_s,x_m,y_m,heading_rad", turning),
                    Contains("18 rad/s") && Contains("heading_deg"));
  CHECK_THAT(notes_of("time_s,x_m,y_m,heading_rad", turning, true), Contains("not plausible"));
  CHECK(notes_of("time_s,x_m,y_m,heading_deg", turning).empty());
  CHECK_THROWS_WITH(
      notes_of("time_s,x_m,y_m,heading_rad", [](double time) { return text_of(200 * time) + ",0,0"; }),
      Contains("200 m/s") && Contains("x_mm"));
  CHECK_THROWS_WITH(notes_of("time_s,left_rad,right_rad",
                             [](double t) { return text_of(400 * t) + "," + text_of(400 * t); }),
                    Contains("400 rad/s") && Contains("left_deg"));
}

TEST_CASE("UTF-16 is named") {
  const TestFolder folder;
  const std::string text = scan_rows(header("time_s"), time_s);
  std::string wide;
  for (const char c : text) wide += std::string{c, '\0'};
  CHECK_THROWS_WITH(import(folder, {folder.write("bom.csv", "\xFF\xFE" + wide)}),
                    Contains("iconv -f UTF-16 "));
  CHECK_THROWS_WITH(import(folder, {folder.write("none.csv", wide)}), Contains("iconv -f UTF-16LE "));
}

TEST_CASE("a recording that is given twice, or with its copy, is refused") {
  const TestFolder folder;
  const std::string text = scan_rows(header("time_s"), time_s);
  const auto a = folder.write("a.csv", text), copy = folder.write("copy.csv", text),
             other = folder.write("other.csv",
                                  scan_rows(header("time_s"), [](int scan) { return time_s(scan) + 1; }));
  CHECK_THROWS_WITH(import(folder, {a, a}), Contains("count twice"));
  CHECK_THROWS_WITH(import(folder, {a, other, copy}),
                    Contains("copy.csv is the same recording as") && Contains("count twice"));
  CHECK(import(folder, {a, other}).empty());
}

}  // namespace import_doubts_test
