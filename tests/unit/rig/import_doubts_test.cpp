// SPDX-License-Identifier: MIT
// What a careless user may give to `rig import`, table by table: a wrong recording is refused or told.
#include <catch2/catch.hpp>
#include <cmath>
#include <functional>

#include "fit/numeric/angle.hpp"
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

TEST_CASE("thousands separators are told from decimal signs") {
  const TestFolder folder;
  const Cell grouped = [](int scan, int beam) {
    const int mm = range_mm(scan, beam);
    std::string text = std::to_string(mm);
    if (mm >= 1000) text.insert(text.size() - 3, ",");
    return text;
  };
  const auto file = folder.write("grouped.csv", scan_rows(
                                                    "", [](int scan) { return scan; }, grouped, ";"));
  for (const char* range : {"range_mm*41", "range_m*41"})
    CHECK_THROWS_WITH(import(folder, {file}, with({"time_s", range})),
                      Contains("'1,020' (line 1)") && Contains("'700' (line 1)") &&
                          Contains("thousands separators") && Contains("--accept-doubts"));
  const auto quoted = folder.write("quoted.csv", scan_rows(header("time_s"), time_s, [&](int s, int b) {
                                     return '"' + grouped(s, b) + '"';
                                   }));
  CHECK_THROWS_WITH(import(folder, {quoted}), Contains("thousands separators"));
  auto accepted = with({"time_s", "range_mm*41"});
  accepted.accept_doubts = true;
  CHECK_THAT(import(folder, {file}, accepted), Contains("not plausible") && Contains("thousands"));
}

TEST_CASE("decimal commas, and a code among metres, are no thousands separators") {
  const TestFolder folder;
  const auto decimal = [](const char* format, double scale) {
    return [=](int scan, int beam) -> std::string {
      char text[32];
      std::snprintf(text, sizeof text, format, range_mm(scan, beam) * scale);
      for (char& c : text)
        if (c == '.') c = ',';
      return text;
    };
  };
  const auto mm = folder.write("mm.csv", scan_rows("", time_s, decimal("%.3f", 1), ";"));
  CHECK(import(folder, {mm}, with({"time_s", "range_mm*41"})).empty());
  const auto m = folder.write("m.csv", scan_rows("", time_s, decimal("%.3f", 0.001), ";"));
  CHECK(import(folder, {m}, with({"time_s", "range_m*41"})).empty());
  const Cell far = decimal("%.3f", 0.003);
  const auto code =
      folder.write("code.csv", scan_rows(
                                   "", time_s, [&](int s, int b) { return b < 4 ? "999" : far(s, b); }, ";"));
  CHECK(import(folder, {code}, with({"time_s", "range_m*41"})).empty());
}

TEST_CASE("ranges of which nearly all are beyond a lidar's reach are refused, with the share") {
  const TestFolder folder;
  const Cell mostly = [](int scan, int beam) {
    return beam < 3 ? plain(scan, beam) : text_of(1e-3 * range_mm(scan, beam));
  };
  const auto file = folder.write("mostly.csv", scan_rows(header("time_s"), time_s, mostly));
  CHECK_THROWS_WITH(import(folder, {file}), Contains("92.7 %") && Contains("760 of 820") &&
                                                Contains("'0.82' (line 2)") && Contains("--columns"));
  const Cell metres = [](int scan, int beam) { return text_of(0.025 * range_mm(scan, beam)); };
  CHECK_THROWS_WITH(import(folder, {folder.write("metres.csv", scan_rows(header("time_s"), time_s, metres))}),
                    Contains("Its largest range is") && Contains("unit"));
  // An open field: most beams have no echo, which is no fault.
  const Cell open = [](int scan, int beam) {
    return beam < 2 ? plain(scan, beam) : beam % 2 == 0 ? "0" : "inf";
  };
  CHECK(import(folder, {folder.write("open.csv", scan_rows(header("time_s"), time_s, open))}).empty());
}

TEST_CASE("words among the ranges are told with their line, and refused where they are many") {
  const TestFolder folder;
  const auto some = [](int each) {
    return [=](int scan, int beam) -> std::string {
      return (beam + scan) % each == 4 ? "err" : plain(scan, beam);
    };
  };
  CHECK_THAT(import(folder, {folder.write("few.csv", scan_rows(header("time_s"), time_s, some(20)))}),
             Contains("no numbers") && Contains("'err' (line 2)"));
  CHECK_THROWS_WITH(import(folder, {folder.write("many.csv", scan_rows(header("time_s"), time_s, some(5)))}),
                    Contains("'err' (line 2)") && Contains("empty"));
}

TEST_CASE("columns that are too many or too few for the names are refused, not dropped") {
  const TestFolder folder;
  std::string same = "time_s";
  for (int beam = 0; beam < beams; ++beam) same += ",range_mm";
  const auto file = folder.write("same.csv", scan_rows(same, time_s));
  CHECK_THROWS_WITH(import(folder, {file}), Contains("more than 8 columns 'range_mm'") &&
                                                Contains("--columns") && Contains("range0_mm"));
  CHECK_THROWS_WITH(import(folder, {file}, with({"time_s", "range_mm*40"})),
                    Contains("--columns names 41 columns, but line 2 holds 42 values") && Contains("NAME*"));
  CHECK_THROWS_WITH(import(folder, {file}, with({"time_s", "range_mm*42"})),
                    Contains("holds no scan") && Contains("fewer than 43 values (20, the first in line 2)") &&
                        !Contains("--topic"));
  CHECK(import(folder, {file}, with({"time_s", "range_mm*"})).empty());
  const Cell longer = [](int s, int b) { return plain(s, b) + (s == 5 && b == 40 ? ",7" : ""); };
  CHECK_THAT(import(folder, {folder.write("longer.csv", scan_rows(header("time_s"), time_s, longer))}),
             Contains("1 of 20 rows") && Contains("more values than columns (1, the first in line 7)"));
  std::string words = scan_rows(header("time_s"), time_s);
  words.insert(words.find('\n') + 1, "err,1\nerr,2\n");
  CHECK_THAT(import(folder, {folder.write("words.csv", words)}), Contains("first row of numbers is line 4"));
  const auto trailing = folder.write("trailing.csv", scan_rows(header("time_s"), time_s, [](int s, int b) {
                                       return plain(s, b) + (b == 40 ? ",," : "");
                                     }));
  CHECK(import(folder, {trailing}).empty());
}

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
  const auto degrees = [](int beam) { return -90 + 4.5 * beam; };
  const auto radians = [](int beam) { return (-90 + 4.5 * beam) * fit::rad_per_deg; };
  CHECK_THROWS_WITH(import(folder, {folder.write("a.csv", point_rows("angle_rad", degrees))}, {}),
                    Contains("beyond two turns") && Contains("--columns"));
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
  auto half = with({});
  half.options.ticks_a_turn = 0.5;
  const auto ticks = folder.write("ticks.csv", log_rows("time_s,left_ticks,right_ticks",
                                                        [](double time) { return text_of(time) + ",0"; }));
  CHECK_THROWS_WITH(import(folder, {ticks}, half), Contains("--ticks-a-turn") && Contains("less than one"));
}

TEST_CASE("an empty range of a point is no fault") {
  const TestFolder folder;
  const auto file =
      folder.write("empty.csv", point_rows(
                                    "angle_deg", [](int beam) { return 2.0 * beam; },
                                    [](int s, int b) { return b % 9 == 4 ? "" : plain(s, b); }));
  CHECK_THAT(import(folder, {file}, {}), !Contains("left out"));
}

TEST_CASE("tables that hold no scan are told what is wrong, by line") {
  const TestFolder folder;
  CHECK_THROWS_WITH(import(folder, {folder.write("comma.csv", "angle,range_mm\n0,5,1000\n1,0,1000\n")}),
                    Contains("names 2 columns, but line 2 holds 3") && Contains("decimal sign"));
  CHECK_THROWS_WITH(import(folder, {folder.write("cr.csv", "time_s,range0_mm\r0,1000\r1,1000\r")}),
                    Contains("CR alone") && Contains("tr '\\r' '\\n'"));
  CHECK_THROWS_WITH(
      import(folder, {folder.write("swapped.csv", "range_mm,angle_deg\n0,1000\n1,1100\n2,1200\n")}),
      Contains("beyond two turns") && Contains("first in line 2") && !Contains("--topic"));
  const std::string iso =
      "time,range0_mm,range1_mm\n2026-05-04T10:00:00Z,1000,1001\n2026-05-04T10:00:01Z,1000,1001\n";
  CHECK_THROWS_WITH(import(folder, {folder.write("iso.csv", iso)}),
                    Contains("line 2 begins with '2026-05-04T10:00:00Z'") && Contains("seconds"));
  const std::string last = "range0_mm,range1_mm,time_s\n1000,1001,2026-05-04T10:00:00Z\n";
  CHECK_THROWS_WITH(import(folder, {folder.write("last.csv", last)}), Contains("the time is no number"));
}

TEST_CASE("UTF-16 is named, and the byte order mark of UTF-8 is passed over") {
  const TestFolder folder;
  const std::string text = scan_rows(header("time_s"), time_s);
  std::string wide;
  for (const char c : text) wide += std::string{c, '\0'};
  CHECK_THROWS_WITH(import(folder, {folder.write("bom.csv", "\xFF\xFE" + wide)}),
                    Contains("iconv -f UTF-16 "));
  CHECK_THROWS_WITH(import(folder, {folder.write("none.csv", wide)}), Contains("iconv -f UTF-16LE "));
  CHECK(import(folder, {folder.write("utf8.csv", "\xEF\xBB\xBF" + text)}).empty());
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
